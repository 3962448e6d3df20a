"""The stages of a training: what each is trained by, where it lies, and which have finished.

A run in stages is one folder. The last stage writes where a run without stages does, so that its
checkpoint is the run's; each earlier one writes into a folder of its own, ``stages/1_NAME``, and
leaves ``stage.json`` there once it has ended.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

from deepring.errors import ConfigError, DataError, FileError
from deepring.experiment.config import Config
from deepring.io.files import replacing
from deepring.io.strict_json import read_json
from deepring.io.text import read_text
from deepring.io.typed import typed

#: What a stage has of its own. All other keys are the run's.
OF_STAGE = (
    *("loss", "sampling", "augmentation", "optimizer", "scheduler"),
    *("trainer", "callbacks", "logger", "trained_parts"),
)

_FOLDER, _ENDED = "stages", "stage.json"


@dataclass(frozen=True)
class StageOutcome:
    """How a stage has ended."""

    checkpoint: str
    """The name of the checkpoint that the next stage begins with, in the stage's folder."""
    score: float | None
    """Validation Recall@1 of the checkpoint; None without validation."""
    seconds: float
    """Training time."""


@dataclass(frozen=True)
class Stage:
    """A part of a training with its own loss, sampling and rate; a whole one if it is the only."""

    name: str
    """Empty where the training has no stages."""
    cfg: Config
    """The config of the run with the stage's own values."""
    folder: Path
    of_whole: tuple[float, float] = (0.0, 1.0)
    """Where it begins and ends, as shares of the training's epochs."""

    @property
    def last_checkpoint(self) -> Path:
        """What an interrupted stage goes on from."""
        return self.folder / "checkpoints" / "last.ckpt"

    def end(self, outcome: StageOutcome) -> None:
        """Note in the stage's folder that it has ended, in one step."""
        with replacing(self.folder / _ENDED) as temporary:
            temporary.write_text(json.dumps(asdict(outcome), indent=2) + "\n", encoding="utf-8")

    def outcome(self) -> StageOutcome | None:
        """How the stage has ended, or None. Raises FileError if its note cannot be read."""
        path = self.folder / _ENDED
        if not path.is_file():
            return None
        expected = "the end of a stage; delete the file to train that stage again"
        text = read_text(path, expected)
        try:
            return typed(StageOutcome, read_json(text), "stage", whole=False)
        except (ConfigError, DataError, ValueError) as error:
            raise FileError(f"{path}: {error}; expected {expected}") from None


def stage_folder(run: Path, names: Sequence[str], name: str) -> Path:
    """The folder of a stage: that of the run for the last one."""
    number = list(names).index(name) + 1
    return run if number == len(names) else run / _FOLDER / f"{number}_{name}"


def stages_of(cfg: Config, folder: Path) -> list[Stage]:
    """The stages of a run, in their order; a training without stages is one."""
    if not cfg.stages:
        return [Stage("", cfg, folder)]
    epochs = [_epochs(values["trainer"]) for values in cfg.stages.values()]
    if None in epochs:  # as long as it takes
        epochs = [1] * len(epochs)
    ends = [0, *accumulate(each or 0 for each in epochs)]
    return [
        Stage(
            name,
            replace(cfg, **_own(values)),
            stage_folder(folder, [*cfg.stages], name),
            (ends[k] / ends[-1], ends[k + 1] / ends[-1]),
        )
        for k, (name, values) in enumerate(cfg.stages.items())
    ]


def stages_left(cfg: Config, folder: Path) -> tuple[list[Stage], list[StageOutcome]]:
    """The stages that are still to be trained, and how those before them have ended.

    The first one goes on from its last checkpoint with ``resume``, if it has one, and begins with
    the checkpoint of the stage before, if that has ended. Raises ConfigError for a ``resume`` that
    is no checkpoint of this run in stages.
    """
    stages = stages_of(cfg, folder)
    if cfg.resume is None or not cfg.stages:
        return stages, []
    own = [stage.last_checkpoint.parent.resolve() for stage in stages]
    if Path(cfg.resume).resolve().parent not in own:
        raise ConfigError(
            f"resume: {cfg.resume}, expected a checkpoint of a stage of the run {folder}; begin "
            "another run with start_from="
        )
    ended: list[StageOutcome] = []
    while len(ended) < len(stages) - 1 and (outcome := stages[len(ended)].outcome()) is not None:
        ended.append(outcome)
    first, *later = stages[len(ended) :]
    resume = str(first.last_checkpoint) if first.last_checkpoint.is_file() else None
    first = replace(first, cfg=replace(first.cfg, resume=resume))
    if ended:
        before = stages[len(ended) - 1]
        first = begun_with(first, before.folder / "checkpoints" / ended[-1].checkpoint)
    return [first, *(_anew(stage) for stage in later)], ended


def begun_with(stage: Stage, checkpoint: Path) -> Stage:
    """The stage, which begins with the weights of a checkpoint."""
    return replace(stage, cfg=replace(stage.cfg, start_from=str(checkpoint)))


def last_checkpoint(folder: Path) -> Path | None:
    """The checkpoint that a broken-off run goes on from, that of its latest stage; or None."""
    earlier = sorted((folder / _FOLDER).glob("*_*"), key=_number, reverse=True)
    paths = (each / "checkpoints" / "last.ckpt" for each in (folder, *earlier))
    return next((path for path in paths if path.is_file()), None)


def run_of(checkpoint: Path) -> Path | None:
    """The run folder that a checkpoint lies in, or None."""
    folder = checkpoint.parent.parent
    if folder.parent.name == _FOLDER and (folder.parent.parent / "config.yaml").is_file():
        folder = folder.parent.parent
    inside = checkpoint.is_file() and (folder / "config.yaml").is_file()
    return folder.resolve() if inside else None


def _anew(stage: Stage) -> Stage:
    return replace(stage, cfg=replace(stage.cfg, resume=None, start_from=None))


def _epochs(trainer: Any) -> int | None:
    """The epochs of a trainer's node, if it states them."""
    epochs = trainer.get("max_epochs") if isinstance(trainer, dict) else None
    return epochs if isinstance(epochs, int) and epochs > 0 else None


def _own(values: dict[str, Any]) -> dict[str, Any]:
    return {key: values[key] for key in OF_STAGE}


def _number(folder: Path) -> int:
    number = folder.name.partition("_")[0]
    return int(number) if number.isdecimal() else 0
