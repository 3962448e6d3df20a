"""What learned methods share: settings that travel in checkpoints, descriptions of scans."""

import importlib
from abc import ABC, abstractmethod
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from deepring.errors import DeepringError
from deepring.methods.base import Comparison, expect_raster
from deepring.methods.settings import SettingsGroup
from deepring.rasters.kinds import Raster, make_raster


class PlainSettings(SettingsGroup):
    """Base of the frozen dataclasses that make a network: a raster's settings, and more.

    They are plain values, which travel in checkpoints and are the method's node in a config.
    """

    label: ClassVar[str]
    """The method's name, for messages."""

    raster: dict[str, Any]

    @classmethod
    def title(cls) -> str:
        """'DeepRING settings', and so on."""
        return f"{cls.label} settings"


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
