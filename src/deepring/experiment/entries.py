"""The entries of ``conf/method``: what each is of, read from the files without composing them."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from deepring.methods.network import NetworkMethod
from deepring.methods.registry import class_at, packaged_methods
from deepring.rasters import RASTERS

#: The ends of names of sizes: minutes on a CPU, hours on a GPU.
SMALL, GPU = "_small", "_gpu"

#: The group of the defaults of methods, which files begin with: ``/settings@method: disco``.
_SETTINGS = "/settings@"


@dataclass(frozen=True)
class Entry:
    """A method's config, ``method=NAME``."""

    name: str
    target: str
    """Dotted path of the class."""
    raster_kind: str | None
    """The kind of raster that the files choose; None is the class's own."""

    @cached_property
    def method(self) -> type[Any]:
        """The class of the method."""
        return class_at(self.target)

    @property
    def learns(self) -> bool:
        """Whether the method is a network, which needs training."""
        return issubclass(self.method, NetworkMethod)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The columns of the points that it needs behind x, y and z, such as 'label'."""
        if self.raster_kind is not None:
            return RASTERS[self.raster_kind].columns
        raster = self.method.settings_class().raster if self.learns else self.method().raster
        return RASTERS[raster["kind"]].columns if self.learns else raster.columns


def method_entries(folder: Path) -> list[Entry]:
    """The entries of ``folder``/method by name."""
    return [_entry(path) for path in sorted((folder / "method").glob("*.yaml"))]


def _entry(path: Path) -> Entry:
    targets, kinds = [], []
    for values in _files(path):
        node = values.get("method", values)  # a file of the whole config, or of the method alone
        targets += [node["_target_"]] if "_target_" in node else []
        kinds += [node["raster"]["kind"]] if "kind" in (node.get("raster") or {}) else []
    return Entry(path.stem, targets[-1], kinds[-1] if kinds else None)


def _files(path: Path) -> Iterator[dict[str, Any]]:
    """The values of the files that an entry is made of, the last one counts."""
    import yaml

    values: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    for each in values.get("defaults", []):
        key, option = next(iter(each.items())) if isinstance(each, dict) else ("", each)
        if key.startswith(_SETTINGS):
            yield {"_target_": packaged_methods()[option]}
        elif not key and option != "_self_":  # another entry, which this one changes
            yield from _files(path.with_name(f"{option.partition('@')[0]}.yaml"))
    yield values
