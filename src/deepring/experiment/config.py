"""The configuration as types: a misspelt key or a value of the wrong type is refused."""

from dataclasses import dataclass, field
from typing import Any, cast

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from deepring.checks import at_least, count, number, one_of, positive
from deepring.data.dataset import DatasetConfig
from deepring.data.online import check_earlier
from deepring.data.readers import reader_names
from deepring.errors import ConfigError
from deepring.evaluation.metrics import Over
from deepring.experiment.config_mistakes import config_mistake
from deepring.localization.candidates import Rerank


@dataclass
class EvaluationSettings:
    """Where, at which radii and over which queries methods are evaluated."""

    #: 'test', 'whole', 'validation', or several, which are evaluated one after the other.
    regions: list[str] = field(default_factory=lambda: ["test"])
    #: Metres; the first is the headline.
    radii: list[float] = field(default_factory=lambda: [10.0, 5.0, 15.0, 20.0, 25.0])
    #: Metres beyond which a best place is wrong; from the radius to there it counts neither as
    #: right nor as wrong. null: wrong where it is not right.
    wrong_beyond: float | None = None
    #: 'answerable' queries, or 'all': a query without an answer then counts as missed.
    over: str = "answerable"
    figures: bool = True  # draw curves, hits and sinograms into figures/
    #: Save the descriptors, so that they can be scored again without scans or network.
    descriptors: bool = False
    #: Tell how far off the relative poses of the best places are, by methods that give them.
    relative_poses: bool = True
    #: Further rows of each method with its best candidates aligned: 'pose' orders them by their
    #: distance from the query, 'locate' also uses the poses of the map. [] aligns none.
    rerank: list[str] = field(default_factory=lambda: ["pose"])
    #: Number of candidates that are aligned.
    candidates: int = 25

    def __post_init__(self) -> None:
        _some("evaluation.regions", self.regions)
        _some("evaluation.radii", self.radii)
        for region in self.regions:
            one_of("evaluation.regions", region, EVALUATED)
        for radius in self.radii:
            positive("evaluation.radii", radius, "metres")
        if self.wrong_beyond is not None:
            at_least("evaluation.wrong_beyond", self.wrong_beyond, max(self.radii), "metres")
        one_of("evaluation.over", self.over, Over)
        for mode in self.rerank:
            one_of("evaluation.rerank", mode, Rerank)
        count("evaluation.candidates", self.candidates)

    @property
    def counted_over(self) -> Over:
        """``over`` as its type."""
        return cast("Over", self.over)


#: The simulated datasets of ``conf/data``, without the worlds that a seed chooses.
SIMULATED = ("sim_custom", "sim_mulran", "sim_nclt")


@dataclass
class PathsConfig:
    """Folders, relative to where the command is started."""

    outputs: str = "outputs"  # of all runs
    datasets: str = "${paths.outputs}/datasets"  # of simulated datasets
    cache: str = "${paths.outputs}/cache"  # of rasters; may be deleted
    #: Folders of downloads by reader and of simulated datasets elsewhere than in ``datasets``, for
    #: sweeps over datasets; a single run has data.root.
    roots: dict[str, str | None] = field(
        default_factory=lambda: dict.fromkeys([*reader_names(), *SIMULATED], "???")
    )
    #: The folder of this run, which Hydra makes.
    run: str = "${hydra:runtime.output_dir}"


@dataclass
class Config:
    """The config of a run."""

    experiment_name: str = "train"  # of the run's folder
    #: The last part of a sweep's folder name.
    sweep_name: str = "sweep"
    seed: int = 0  # of the weights, the batches and all that is drawn
    #: The dataset to train and to test on, unless train_data and test_data name others.
    data: DatasetConfig = field(default_factory=DatasetConfig)
    #: Datasets to train on by name, each with the keys of ``data``; ``train=`` fills it.
    train_data: dict[str, DatasetConfig] = field(default_factory=dict)
    #: Datasets to test on by name; ``test=`` fills it.
    test_data: dict[str, DatasetConfig] = field(default_factory=dict)
    #: Which points of a scan count, for all methods: their rasters refer to it.
    preprocessing: dict[str, Any] = field(default_factory=dict)
    #: The class of the method and its settings. With null, those of the checkpoint.
    method: dict[str, Any] | None = None
    #: Further methods to evaluate, which learn nothing.
    methods: dict[str, Any] = field(default_factory=dict)
    #: The training scheme, see `deepring.training.scheme`, and how its batches are sampled.
    sampling: dict[str, Any] | None = None
    #: What training scans lose, see `deepring.training.augmentation`; nothing with null.
    augmentation: dict[str, Any] | None = None
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)
    paths: PathsConfig = field(default_factory=PathsConfig)
    # Built by hydra's instantiate, which checks their arguments.
    loss: Any = None
    optimizer: Any = None
    scheduler: Any = None
    trainer: Any = None
    callbacks: dict[str, Any] = field(default_factory=dict)
    logger: Any = None
    #: Processes that sample training batches.
    workers: int = 0
    #: Evaluate the best checkpoint at the end of training.
    evaluate: bool = True
    #: Test regions that hold training scans: 'refuse', 'leave_out' or 'allow'.
    overlap: str = "refuse"
    #: The stages of a training by name, in their order: what each has in place of the keys of
    #: training above. ``stages=[A,B]`` names files of ``stage``; +stages.A.KEY=VALUE differs.
    stages: dict[str, Any] = field(default_factory=dict)
    #: Begin a training with the weights of this checkpoint, which an earlier stage trained.
    start_from: str | None = None
    #: The parts of the network that are trained, such as [aggregate]; the others keep their
    #: weights. null: all.
    trained_parts: list[str] | None = None
    #: Resume training from this checkpoint.
    resume: str | None = None
    #: The trained network to evaluate; with null, only the other methods.
    checkpoint: str | None = None

    def __post_init__(self) -> None:
        count("seed", self.seed, 0)
        if self.seed > HIGHEST_SEED:
            raise ConfigError(f"seed: {self.seed}, expected a whole number up to {HIGHEST_SEED}")
        count("workers", self.workers, 0)
        one_of("overlap", self.overlap, OVERLAP)
        datasets = {"data": self.data}
        datasets |= {f"train_data.{name}": config for name, config in self.train_data.items()}
        datasets |= {f"test_data.{name}": config for name, config in self.test_data.items()}
        for key, config in datasets.items():
            _check_dataset(key, config)


#: Regions that a method can be evaluated on.
EVALUATED = ("test", "whole", "validation")

#: The seeds that NumPy takes.
HIGHEST_SEED = 2**32 - 1

#: What to do about test regions that hold training scans.
OVERLAP = ("refuse", "leave_out", "allow")


def check_config(composed: DictConfig) -> Config:
    """The composed config, resolved and checked, as plain objects.

    Raises ConfigError that names the key where a value is missing, of another type, or cannot be
    resolved.
    """
    try:
        plain = OmegaConf.to_container(composed, resolve=True)
        # Once more over the schema, since +KEY=VALUE adds what it does not know.
        checked = OmegaConf.merge(OmegaConf.structured(Config), plain)
        missing = OmegaConf.missing_keys(checked)
        # The folder of a download is needed only if a dataset lies in it.
        for key in [key for key in missing if key.startswith("paths.")]:
            OmegaConf.update(checked, key, None)
            missing.remove(key)
        if missing:
            names = ", ".join(sorted(missing))
            raise ConfigError(
                f"{names}: no value, expected one; give it as {sorted(missing)[0]}=VALUE"
            )
        return cast("Config", OmegaConf.to_object(checked))
    except OmegaConfBaseException as error:
        raise ConfigError(config_mistake(error) or "config: cannot be resolved") from error


def _check_dataset(key: str, config: DatasetConfig) -> None:
    """Raise ConfigError that names the key of a length or seed that is negative or not finite."""
    lengths = {f"spacing.{name}": value for name, value in vars(config.spacing).items()}
    lengths |= {name: getattr(config, name) for name in ("revisit_radius", "revisit_apart")}
    check_earlier(config.earlier, f"{key}.earlier", config.split == "online")
    lengths["regions.margin"] = config.regions.margin
    for name, value in lengths.items():
        at_least(f"{key}.{name}", value, 0, "metres")
    if config.query_turn_seed is not None:
        count(f"{key}.query_turn_seed", config.query_turn_seed, 0)
    if config.ground_z is not None:
        number(f"{key}.ground_z", config.ground_z, "metres")


def _some(name: str, values: list[Any]) -> None:
    """Raise ConfigError unless there is a value, and no value occurs twice."""
    if not values or len(set(values)) < len(values):
        raise ConfigError(f"{name}: {values}, expected at least one value, and no value twice")
