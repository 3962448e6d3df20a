"""Pages of every config key: those of the schema, and those of each option of each group."""

import inspect
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from docsite.config_files import comments_of, composed, head_of, writes_globally
from docsite.markdown import cell, code, table
from docsite.parameters import Parameter, parameters

FOLDER = "reference/config"

_HEAD = ("key", "default", "type", "what it is")

_INTRODUCTION = """\
# Config keys

`deepring train` and `deepring evaluate` take each key below as `KEY=VALUE`, and each group as
`GROUP=OPTION`: `deepring train data=nclt data.root=FOLDER trainer.max_epochs=40`.
`deepring train --cfg job` prints all values that a run would have. The tables are made out of the
code and `conf/`; a default that differs by option stands on the group's page.
"""


def config_pages() -> dict[str, str]:
    """The Markdown of the config's pages by path."""
    from deepring.experiment.config_groups import chosen_options, config_folder, group_options

    folder = config_folder()
    groups = group_options(folder)
    chosen = chosen_options(folder, "train")
    with composed(folder) as compose:
        pages = {
            f"{FOLDER}/{_file(group)}.md": "\n\n".join(
                _group(group, options, chosen.get(group), folder, compose)
            )
            + "\n"
            for group, options in groups.items()
        }
        index = "\n\n".join(_index(groups, chosen, folder, compose("train"))) + "\n"
    return {f"{FOLDER}/index.md": index, **pages, f"{FOLDER}/simulation.md": _knobs()}


def rows_of(
    key: str, node: Any, described: Mapping[str, Parameter], notes: Mapping[str, str]
) -> list[list[str]]:
    """A row for each value below a node of a config.

    Args:
        key: of the node.
        node: its values.
        described: what the node's class says of its arguments.
        notes: comments of config files by key.
    """
    rows = []
    missing = {
        name: each.default
        for name, each in described.items()
        if name not in node and _plain(each.default) and key.partition(".")[0] not in _FOREIGN
    }
    for name, value in {**node, **missing}.items():
        path = f"{key}.{name}" if key else name
        about = described.get(name, Parameter("", None, ""))
        note = notes.get(path) or about.comment or _usual(path)
        if isinstance(value, Mapping) and value:
            inner = _described(value, about.default)
            rows += [[code(path), "", "", cell(note)]] if note else []
            rows += rows_of(path, value, inner, notes)
        else:
            kind = about.type or type(value).__name__.replace("NoneType", "")
            rows.append([code(path), code(_yaml(value)), code(kind), cell(note)])
    return rows


#: What keys of these names are wherever they stand.
_USUAL = {
    r".*\b_target_": "the class",
    r"methods?\.(?:\w+\.)?label": "the method's name in tables",
    r"methods?\.(?:\w+\.)?note": "how it differs from what was published, below tables",
    r".*\braster\.kind": "the class of the raster",
    r".*\braster\.preprocessing": "which points count; mostly as the group `preprocessing` says",
    r"paths\.roots\.\w+": "the folder of downloads of this reader",
}


def _usual(path: str) -> str:
    return next((text for key, text in _USUAL.items() if re.fullmatch(key, path)), "")


#: Nodes of other libraries' classes: the keys that the package states are listed, not all theirs.
_FOREIGN = ("optimizer", "scheduler", "trainer", "callbacks", "logger")


def _index(
    groups: Mapping[str, list[str]],
    chosen: Mapping[str, str | None],
    folder: Path,
    config: Mapping[str, Any],
) -> Iterator[str]:
    from deepring.experiment.config import Config

    yield _INTRODUCTION.rstrip()
    yield "## Groups"
    yield table(
        ["group", "default", "options"],
        [
            [
                f"[`{group}`]({_file(group)}.md)",
                code(chosen.get(group) or ""),
                cell(", ".join(options)),
            ]
            for group, options in groups.items()
        ],
    )
    yield "Knobs of `deepring simulate` are [a page of their own](simulation.md)."
    yield "## Keys of every run"
    listed = {key: value for key, value in config.items() if key not in groups and key != "hydra"}
    described = {key: each for key, each in parameters(Config).items() if key in listed}
    notes = comments_of(folder / "base.yaml") | comments_of(folder / "train.yaml")
    yield table(_HEAD, rows_of("", listed, described, notes))


def _group(
    group: str, options: list[str], chosen: str | None, folder: Path, compose: Any
) -> Iterator[str]:
    yield f"# {group}"
    default = (
        f"`{group}={chosen}` by default."
        if chosen
        else f"None by default; `{group}=OPTION` chooses one."
    )
    yield f"{default} The options: {', '.join(f'[`{name}`](#{name})' for name in options)}."
    for name in options:
        file = folder / group / f"{name}.yaml"
        yield f"## {name} {{#{name}}}"
        yield from _option(group, name, file, compose)


def _option(group: str, name: str, file: Path, compose: Any) -> Iterator[str]:
    written = file.is_file()
    if written and head_of(file):
        yield head_of(file)
    if group in ("train", "test") and not written:
        yield f"The dataset [`data={name}`](data.md#{name})."
        return
    if group == "stages":
        yield f"The values of [`stage={name}`](stage.md#{name}), as one stage of the training."
        return
    if written and writes_globally(file):
        text = file.read_text(encoding="utf-8").rstrip()
        yield f'```yaml title="conf/{group}/{name}.yaml"\n{text}\n```'
        if group != "method":
            return
    key = group.split("/")[0] if group == "method/representation" else group.replace("/", ".")
    node = _node(compose(group, name), key)
    notes = comments_of(file, key) if written else {}
    yield _about(_class_of(node, _schema(key)))
    yield table(_HEAD, rows_of(key, node, _described(node, _schema(key)), notes))


def _node(config: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    for part in key.split("."):
        config = config[part]
    return config


def _schema(key: str) -> Any:
    """The class that states the keys of a node without ``_target_``."""
    from deepring.data.dataset import DatasetConfig
    from deepring.methods.deepring import DeepRingSettings
    from deepring.rasters import Preprocessing
    from deepring.training.augmentation import Augmentation

    if key.startswith("method"):
        value: Any = DeepRingSettings()
        for part in key.split(".")[1:]:
            value = getattr(value, part) or parameters(DeepRingSettings)[part].type
        return _polar() if isinstance(value, str) else value
    return {
        "data": DatasetConfig,
        "preprocessing": Preprocessing,
        "augmentation": Augmentation,
    }.get(key)


def _polar() -> Any:
    from deepring.methods.deepring.polar_branch import PolarSettings

    return PolarSettings


def _class_of(node: Mapping[str, Any], schema: Any) -> Any:
    """The class whose arguments a node's keys are: its target's, its raster, or its schema."""
    from hydra.utils import get_object

    from deepring.methods.network import NetworkMethod
    from deepring.rasters import RASTERS

    if "_target_" in node:
        target = get_object(node["_target_"])
        is_network = inspect.isclass(target) and issubclass(target, NetworkMethod)
        return target.settings_class if is_network else target
    if node.get("kind") in RASTERS and "preprocessing" in node:
        return RASTERS[node["kind"]]
    return schema if inspect.isclass(schema) else type(schema)


def _described(node: Mapping[str, Any], schema: Any) -> dict[str, Parameter]:
    cls = _class_of(node, schema)
    return (
        parameters(cls) if cls.__module__.partition(".")[0] not in ("builtins", "inspect") else {}
    )


def _knobs() -> str:
    from deepring.simulation import presets
    from deepring.simulation.settings import Layout, SimulationSettings

    names = get_args(Layout)
    made = {name: vars(presets.preset(name)) for name in names}
    rows = [
        [
            code(knob),
            *(code(_yaml(made[name][knob])) for name in names),
            code(each.type),
            cell(each.comment),
        ]
        for knob, each in parameters(SimulationSettings).items()
    ]
    about = "`deepring simulate LAYOUT KNOB=VALUE ...`; [docs](../../simulation.md). " + _about(
        SimulationSettings
    )
    return (
        f"# Knobs of simulate\n\n{about}\n\n{table(('knob', *names, 'type', 'what it is'), rows)}\n"
    )


def _about(cls: Any) -> str:
    """What a class of the package says of itself, up to its arguments, errors and examples."""
    if not getattr(cls, "__module__", "").startswith("deepring"):
        return ""
    text = inspect.getdoc(cls) or ""
    return re.split(r"\n+(?:Args|Raises|Returns):|\n+ *>>>", text)[0].strip()


def _plain(value: Any) -> bool:
    return value is None or isinstance(value, bool | int | float | str | list | tuple)


def _yaml(value: Any) -> str:
    import yaml

    if isinstance(value, tuple):
        value = list(value)
    return yaml.safe_dump(value, default_flow_style=True, width=10**6).removesuffix("...\n").strip()


def _file(group: str) -> str:
    return group.replace("/", "_")
