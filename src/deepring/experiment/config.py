"""The configuration as types: a misspelt key or a value of the wrong type is refused."""

import math
from dataclasses import dataclass, field
from typing import Any, cast, get_args

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from deepring.checks import one_of
from deepring.data.dataset import DatasetConfig
from deepring.errors import DeepringError
from deepring.evaluation.metrics import Over
from deepring.localization.candidates import Rerank


@dataclass
class PreprocessingConfig:
    """See `deepring.rasters.Preprocessing`."""

    height: tuple[float, float] = (-5.0, 20.0)
    clearance: float | None = 0.5
    window: int = 5
    cell: float = 140.0 / 120
    extent: float = 70.0


@dataclass
class RepresentationConfig:
    """The raster (its kind and its fields), a sinogram's angles and bins (else null), pooling."""

    raster: dict[str, Any] = field(default_factory=lambda: {"kind": "bev"})
    angles: int | None = 120
    bins: int | None = 120
    #: Range of a sinogram's θ: 'full', [0, 2π), or 'half', [0, π).
    theta_range: str = "full"
    pool: int = 1


@dataclass
class EncoderConfig:
    """See `deepring.nn.unet.CircularUNet`."""

    widths: list[int] = field(default_factory=lambda: [64, 128, 256, 512])
    convolutions: int = 2
    norm: str = "batch"
    tau_padding: str = "circular"
    stem: int = 1


@dataclass
class AggregationConfig:
    """See `deepring.nn.aggregation`."""

    kind: str = "dft"


@dataclass
class SimilarityConfig:
    """What compares two descriptors, and how a descriptor is normalised before."""

    kind: str = "correlation"
    normalisation: str = "unit"


@dataclass
class EvaluationConfig:
    """Where, at which radii (metres; the first is the headline), and counted over what."""

    regions: list[str] = field(default_factory=lambda: ["test"])
    radii: list[float] = field(default_factory=lambda: [10.0, 5.0, 15.0, 20.0, 25.0])
    #: 'answerable' queries, or 'all': a query without an answer then counts as missed.
    over: str = "answerable"
    figures: bool = True
    #: Keep the descriptors, so that they can be scored again without scans or network.
    descriptors: bool = False
    #: Rows further to each method's own, its best candidates aligned: 'pose', 'locate'.
    rerank: list[str] = field(default_factory=list)
    #: Candidates that are aligned.
    candidates: int = 25


@dataclass
class PathsConfig:
    """Folders, relative to where the command is started."""

    outputs: str = "outputs"
    datasets: str = "outputs/datasets"
    cache: str = "outputs/cache"
    #: Where downloads lie, for all runs of a sweep; data.root of one dataset where not given.
    nclt: str = "???"
    mulran: str = "???"
    kitti: str = "???"
    own: str = "???"
    #: This run's own folder, which Hydra makes.
    run: str = "???"


@dataclass
class Config:
    """Everything a run is made of."""

    experiment_name: str = "train"
    #: The last part of a sweep's folder name.
    sweep_name: str = "sweep"
    seed: int = 0
    #: The dataset to train and to test on, unless train_data and test_data name others.
    data: DatasetConfig = field(default_factory=DatasetConfig)
    train_data: dict[str, DatasetConfig] = field(default_factory=dict)
    test_data: dict[str, DatasetConfig] = field(default_factory=dict)
    preprocessing: PreprocessingConfig = field(default_factory=PreprocessingConfig)
    #: The class of the method, and the settings of one other than DeepRING, which is made of the
    #: four groups that follow; these are null for the others. Null takes what a checkpoint holds.
    method: Any = None
    representation: RepresentationConfig | None = None
    encoder: EncoderConfig | None = None
    aggregation: AggregationConfig | None = None
    similarity: SimilarityConfig | None = None
    #: The training scheme, see `deepring.training.scheme`, and how its batches are drawn.
    sampling: Any = None
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    paths: PathsConfig = field(default_factory=PathsConfig)
    # Built by hydra's instantiate, which checks their arguments.
    loss: Any = None
    optimizer: Any = None
    scheduler: Any = None
    trainer: Any = None
    callbacks: dict[str, Any] = field(default_factory=dict)
    logger: Any = None
    #: Methods evaluated besides.
    methods: dict[str, Any] = field(default_factory=dict)
    #: Processes that draw training batches.
    workers: int = 0
    #: Evaluate the best checkpoint at the end of training.
    evaluate: bool = True
    #: Test regions that hold training scans: 'refuse', 'leave_out' or 'allow'.
    overlap: str = "refuse"
    #: Resume training from this checkpoint.
    resume: str | None = None
    #: The trained network to evaluate; None evaluates the other methods alone.
    checkpoint: str | None = None


#: Regions that a method can be evaluated on.
EVALUATED = ("test", "whole", "validation")

#: What to do about test regions that hold training scans.
OVERLAP = ("refuse", "leave_out", "allow")


def counted_over(cfg: Config) -> Over:
    """``evaluation.over``, checked."""
    over = cfg.evaluation.over
    if over not in get_args(Over):
        raise DeepringError(f"evaluation.over: {over!r}, expected 'answerable' or 'all'")
    return cast("Over", over)


def flattened(node: Any, prefix: str = "") -> dict[str, Any]:
    """Nested dicts as one with dotted keys, for comparing and for listing; empty ones vanish."""
    if not isinstance(node, dict):
        return {prefix: node}
    flat: dict[str, Any] = {}
    for key, value in node.items():
        flat |= flattened(value, f"{prefix}.{key}" if prefix else str(key))
    return flat


def register_schema() -> None:
    """Make `Config` known to Hydra, which then refuses unknown keys and wrong types."""
    ConfigStore.instance().store(name="schema", node=Config)


def check_config(composed: DictConfig) -> Config:
    """The composed config, resolved; it stays a DictConfig underneath.

    Raises DeepringError that names the key where a value is missing or cannot be resolved.
    """
    try:
        plain = OmegaConf.to_container(composed, resolve=True)
        # Once more over the schema, since +KEY=VALUE adds what it does not know.
        checked = OmegaConf.merge(OmegaConf.structured(Config), plain)
        # A download's folder is missed where a dataset lies in it, not otherwise.
        missing = {k for k in OmegaConf.missing_keys(checked) if k.rpartition(".")[0] != "paths"}
    except OmegaConfBaseException as error:
        key = getattr(error, "full_key", None)
        first = str(error).splitlines()[0]
        raise DeepringError(f"config{f' key {key}' if key else ''}: {first}") from error
    if missing:
        names = ", ".join(sorted(missing))
        raise DeepringError(f"config: no value for {names}; give it as {sorted(missing)[0]}=VALUE")
    cfg = cast("Config", checked)
    _check_values(cfg)
    return cfg


def _check_values(cfg: Config) -> None:
    counted_over(cfg)
    for name in ("seed", "workers"):
        if getattr(cfg, name) < 0:
            raise DeepringError(f"{name}: {getattr(cfg, name)}, expected at least 0")
    regions = list(cfg.evaluation.regions)
    if not regions or len(set(regions)) < len(regions) or not set(regions) <= set(EVALUATED):
        raise DeepringError(
            f"evaluation.regions: {regions}, expected one or several of {', '.join(EVALUATED)}"
        )
    for mode in cfg.evaluation.rerank:
        one_of("evaluation.rerank", mode, Rerank)
    if cfg.evaluation.candidates < 1:
        raise DeepringError(
            f"evaluation.candidates: {cfg.evaluation.candidates}, expected at least 1"
        )
    if cfg.overlap not in OVERLAP:
        raise DeepringError(f"overlap: {cfg.overlap!r}, expected one of {', '.join(OVERLAP)}")
    radii = list(cfg.evaluation.radii)
    if not radii or len(set(radii)) < len(radii) or not all(0 < r < math.inf for r in radii):
        raise DeepringError(
            f"evaluation.radii: {radii}, expected different lengths in metres, at least one"
        )
