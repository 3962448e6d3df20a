"""A ModelCheckpoint that still knows its best after its folder was moved."""

from pathlib import Path
from typing import Any

from lightning.pytorch.callbacks import ModelCheckpoint


class MovableCheckpoint(ModelCheckpoint):
    """Lightning's ModelCheckpoint, but a resumed run may lie elsewhere than when it was stopped.

    Lightning forgets the best score where the folder is another, so that a later, worse epoch
    would take the place of the best one.
    """

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Point the kept paths at where the files lie now, then restore all."""
        folder = Path(str(self.dirpath))

        def here(path: str) -> str:
            return str(folder / Path(path).name) if path else path

        moved = dict(state_dict)
        moved["dirpath"] = str(self.dirpath)
        for key in ("best_model_path", "kth_best_model_path", "last_model_path"):
            moved[key] = here(moved[key])
        moved["best_k_models"] = {here(path): v for path, v in moved["best_k_models"].items()}
        super().load_state_dict(moved)
