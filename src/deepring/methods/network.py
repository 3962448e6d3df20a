"""What learned methods share: settings that travel in checkpoints, descriptions of scans."""

from dataclasses import fields
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn

from deepring.core.rasters import Raster, make_raster
from deepring.errors import DeepringError
from deepring.methods.base import expect_raster


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


class NetworkMethod(nn.Module):
    """A method that is a network: rasters (b, *raster.shape) in, descriptors out.

    Subclasses define ``forward`` and ``compare``; see `deepring.methods.base.Method`.

    Args:
        label: the method's name, for messages.
        raster: settings of the raster it takes.
        kind: of the raster; another raises DeepringError. None takes any.
    """

    def __init__(
        self, label: str, raster: dict[str, Any], kind: type[Raster] | None = None
    ) -> None:
        super().__init__()
        self._raster = make_raster(raster)
        if kind is not None:
            expect_raster(label, self._raster, kind)

    @property
    def raster(self) -> Raster:
        """The array of a scan that the network takes."""
        return self._raster

    @torch.no_grad()
    def describe(self, rasters: Tensor) -> Tensor:
        """`forward` in evaluation mode, on the network's device; descriptors come back on it."""
        training = self.training
        self.eval()
        try:
            return self(rasters.to(next(self.parameters()).device))
        finally:
            self.train(training)
