"""What learned methods share: settings that travel in checkpoints, descriptions of scans."""

import importlib
from abc import ABC, abstractmethod
from dataclasses import fields
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn

from deepring.errors import DeepringError
from deepring.methods.base import Comparison, expect_raster
from deepring.rasters import Raster, make_raster


class PlainSettings:
    """Base of frozen dataclasses of plain values, among them ``raster``, a raster's settings.

    Sequences become tuples, those within ``raster`` lists, so that equal settings compare equal
    wherever they come from.
    """

    label: ClassVar[str]
    """The method's name, for messages."""

    raster: dict[str, Any]

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, list):
                object.__setattr__(self, name, tuple(value))
        object.__setattr__(self, "raster", _plain(self.raster))

    def to_dict(self) -> dict[str, Any]:
        """Plain dict of lists, strings and numbers, as `from_dict` takes it."""
        return {f.name: _plain(getattr(self, f.name)) for f in fields(self)}  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Raises DeepringError where the values do not make settings."""
        try:
            return cls(**values)
        except TypeError as error:
            raise DeepringError(f"{cls.label} settings: {error}") from None


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


class NetworkMethod(nn.Module, ABC):
    """A method that is a network: rasters (b, *raster.shape) in, descriptors out.

    Subclasses name their settings' class, are made of such settings, and define ``forward`` and
    ``compare``; see `deepring.methods.base.Method`.

    Args:
        settings: everything that makes a descriptor but the weights.
        kind: of the raster; another raises DeepringError. None takes any.
    """

    settings_class: ClassVar[type[PlainSettings]]

    def __init__(self, settings: PlainSettings, kind: type[Raster] | None = None) -> None:
        super().__init__()
        self.settings = settings
        self._raster = make_raster(settings.raster)
        if kind is not None:
            expect_raster(settings.label, self._raster, kind)

    @property
    def raster(self) -> Raster:
        """The array of a scan that the network takes."""
        return self._raster

    @abstractmethod
    def compare(self, queries: Tensor, database: Tensor) -> Comparison:
        """Compare descriptors (q, ...) with descriptors (d, ...)."""

    def score(self, queries: Tensor, database: Tensor) -> Tensor:
        """The scores of `compare` alone, (q, d)."""
        return self.compare(queries, database).score

    def vectors(self, descriptors: Tensor) -> Tensor:
        """What losses of distances compare: (b, ...) -> (b, d); the descriptors themselves."""
        return descriptors.flatten(1)

    @torch.no_grad()
    def describe(self, rasters: Tensor) -> Tensor:
        """`forward` in evaluation mode, on the network's device; descriptors come back on it."""
        training = self.training
        self.eval()
        try:
            return self(rasters.to(next(self.parameters()).device))
        finally:
            self.train(training)


def class_path(method: NetworkMethod) -> str:
    """Where the method's class is found again: what a checkpoint and a config name it by."""
    return f"{type(method).__module__}.{type(method).__qualname__}"


def network_class(path: str) -> type[NetworkMethod]:
    """The class at a dotted path. Raises DeepringError where there is no `NetworkMethod`."""
    module, _, name = path.rpartition(".")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise DeepringError(
            f"method: {path!r} cannot be imported ({error}); expected the class of a method, such "
            "as deepring.methods.deepring.DeepRing"
        ) from None
    if not (isinstance(found, type) and issubclass(found, NetworkMethod)):
        raise DeepringError(f"method: {path!r} is no NetworkMethod; expected one that is trained")
    return found
