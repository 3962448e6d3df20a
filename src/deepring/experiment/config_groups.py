"""The options of the config groups: the files of ``conf/``, and those generated from the library.

An option is generated if it is a default of the library, or a name for a choice; files state what
differs from these. All names are known here without importing what they stand for.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from deepring.methods.registry import packaged_methods

Make = Callable[[], dict[str, Any]]
"""Makes an option's values, importing what it needs."""

#: DeepRING's representations: the raster's kind, and settings beside the defaults. The rows and
#: columns of other rasters than a BEV are the raster's.
_REPRESENTATIONS: dict[str, tuple[str, dict[str, Any]]] = {
    "sinogram": ("bev", {}),
    "sinogram_half": ("bev", {"theta_range": "half"}),
    "polar_gram": ("polar", {"angles": None, "bins": None}),
    "range_image": ("range", {"angles": None, "bins": None}),
}
_AGGREGATIONS: dict[str, dict[str, Any]] = {
    "dft": {},
    "dft2": {},
    "gap": {},
    "gmp": {},
    "multi_gap": {},
    "cross_spectra": {"gaps": [12.0], "frequencies": 30},
}
_SIMILARITIES = ("correlation", "l2", "cosine")

#: The group that the generated settings of methods are in. Files of ``conf/method`` begin with
#: them; they are not chosen on the command line.
SETTINGS = "settings"

#: Groups whose options write to another key than their own.
_PACKAGES = {
    "method/representation": "method",
    **dict.fromkeys(("train", "test", "stages"), "_global_"),
}


def config_folder() -> Path:
    """The packaged ``conf/``, or that of the checkout that the package runs from."""
    package = Path(__file__).resolve().parents[1]
    packaged = package / "conf"
    return packaged if packaged.is_dir() else package.parents[1] / "conf"


def register_configs() -> None:
    """Make the schema and the generated options known to Hydra.

    The schema makes Hydra refuse unknown keys and wrong types.
    """
    from hydra.core.config_store import ConfigStore

    from deepring.experiment.config import Config

    store = ConfigStore.instance().store
    store(name="schema", node=Config)
    for group, options in _generated(config_folder()).items():
        for name, make in options.items():
            store(group=group, name=name, node=make(), package=_PACKAGES.get(group))


def group_options(folder: Path) -> dict[str, list[str]]:
    """The options of each group, both sorted by name."""
    options: dict[str, set[str]] = {
        group: set(makes) for group, makes in _generated(folder).items() if group != SETTINGS
    }
    for file in folder.rglob("*.yaml"):
        group = file.parent.relative_to(folder).as_posix()
        if group not in (".", "hydra"):
            options.setdefault(group, set()).add(file.stem)
    return {group: sorted(options[group]) for group in sorted(options)}


def chosen_options(folder: Path, config: str) -> dict[str, str | None]:
    """The default option of each group of a primary config; None for no option."""
    return dict(_chosen(folder, folder / f"{config}.yaml"))


def _chosen(folder: Path, file: Path) -> Iterator[tuple[str, str | None]]:
    import yaml

    group = file.parent.relative_to(folder).as_posix().removeprefix(".")
    for entry in (yaml.safe_load(file.read_text(encoding="utf-8")) or {}).get("defaults", []):
        if isinstance(entry, str):
            if (file.parent / f"{entry}.yaml").is_file():
                yield from _chosen(folder, file.parent / f"{entry}.yaml")
            continue
        ((key, option),) = entry.items()
        if "@" in key or key.startswith(("override ", "/")) or key == "hydra":
            continue
        name = f"{group}/{key}" if group else key
        yield name, option
        if option is not None and (folder / name / f"{option}.yaml").is_file():
            yield from _chosen(folder, folder / name / f"{option}.yaml")


def _generated(folder: Path) -> Mapping[str, Mapping[str, Make]]:
    datasets = sorted(file.stem for file in (folder / "data").glob("*.yaml"))
    stages = sorted(file.stem for file in (folder / "stage").glob("*.yaml"))
    return {
        SETTINGS: {
            name: partial(_method, path)
            for name, path in packaged_methods().items()
            if name != "deepring"  # its parts are groups of their own
        },
        "preprocessing": {"local_minimum": _preprocessing},
        "method/representation": {
            name: partial(_representation, *choice) for name, choice in _REPRESENTATIONS.items()
        },
        "method/encoder": {"unet": _encoder},
        "method/aggregation": {
            name: partial(_aggregation, name, values) for name, values in _AGGREGATIONS.items()
        },
        "method/similarity": {name: partial(_similarity, name) for name in _SIMILARITIES},
        "method/polar": {"bev": _polar},
        "train": {name: partial(_dataset, "train_data", name) for name in datasets},
        "test": {name: partial(_dataset, "test_data", name) for name in datasets},
        "stages": {name: partial(_stage, name) for name in stages},
    }


def _dataset(key: str, name: str) -> dict[str, Any]:
    """The defaults list that adds a dataset to ``train_data`` or ``test_data``."""
    return {"defaults": [{f"/data@{key}.{name}": name}]}


def _stage(name: str) -> dict[str, Any]:
    """The name of a stage in ``stages``; its values are filled in when the config is composed."""
    return {"stages": {name: {}}}


def _preprocessing() -> dict[str, Any]:
    from dataclasses import asdict

    from deepring.rasters.preprocessing import Preprocessing

    return asdict(Preprocessing())


def _raster(settings: dict[str, Any]) -> dict[str, Any]:
    """A raster with the config's preprocessing, unless its default is another."""
    default = settings["preprocessing"]
    usual = {**_preprocessing(), "height": default["height"]} == default
    return {**settings, "preprocessing": "${preprocessing}" if usual else default}


def _method(path: str) -> dict[str, Any]:
    """The class with the defaults of its settings, or of its arguments if it learns nothing."""
    import inspect

    from hydra.utils import get_class

    from deepring.methods.network import NetworkMethod
    from deepring.rasters import raster_settings

    cls: Any = get_class(path)
    if issubclass(cls, NetworkMethod):
        values = cls.settings_class().to_dict()
    else:
        values = {name: p.default for name, p in inspect.signature(cls).parameters.items()}
        values["raster"] = raster_settings(cls().raster)
    return {"_target_": path, **values, "raster": _raster(values["raster"])}


def _representation(kind: str, changes: dict[str, Any]) -> dict[str, Any]:
    from deepring.methods.deepring import RepresentationSettings
    from deepring.rasters import make_raster, raster_settings

    return {
        "raster": _raster(raster_settings(make_raster({"kind": kind}))),
        "representation": RepresentationSettings(**changes).to_dict(),
    }


def _encoder() -> dict[str, Any]:
    from deepring.methods.deepring import EncoderSettings

    return EncoderSettings().to_dict()


def _aggregation(kind: str, values: dict[str, Any]) -> dict[str, Any]:
    from deepring.methods.deepring import AggregationSettings

    return AggregationSettings(kind, **values).to_dict()


def _similarity(kind: str) -> dict[str, Any]:
    from deepring.methods.deepring import SimilaritySettings

    return SimilaritySettings(kind).to_dict()


def _polar() -> dict[str, Any]:
    from deepring.methods.deepring.polar_branch import PolarSettings

    return PolarSettings().to_dict()
