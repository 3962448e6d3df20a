"""The curves of a training for TensorBoard."""

from collections.abc import Mapping
from typing import Any

from lightning.pytorch.loggers import TensorBoardLogger


class Curves(TensorBoardLogger):
    """Lightning's logger, with the epoch among the curves of the training.

    Lightning adds it to all that is logged, as a group of its own before all others.
    """

    def log_metrics(self, metrics: Mapping[str, Any], step: int | None = None) -> None:
        """Write values at a step."""
        renamed = {"train/epoch" if name == "epoch" else name: metrics[name] for name in metrics}
        super().log_metrics(renamed, step)
