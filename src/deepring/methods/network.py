"""The base of learned methods: settings that travel in checkpoints, descriptions of scans."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from typing import Any, ClassVar, Self, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from deepring.checks import of_type
from deepring.errors import ConfigError
from deepring.io.typed import plain, typed
from deepring.methods import registry
from deepring.methods.given import check_calls, given_rasters
from deepring.methods.method import Comparison
from deepring.rasters import Raster, make_raster


class PlainSettings:
    """Base of the frozen dataclasses that make a network, and of the groups within them.

    They are plain values, which travel in checkpoints and are the method's node in a config: those
    of a whole method have a ``raster``, a dict of its settings. Sequences become tuples, those
    within dicts lists, so that equal settings compare equal wherever they come from.
    """

    label: ClassVar[str] = ""
    """The method's name, for messages."""

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, list):
                object.__setattr__(self, name, tuple(value))
            elif isinstance(value, dict):
                object.__setattr__(self, name, plain(value))

    def to_dict(self) -> dict[str, Any]:
        """Plain dict of dicts, lists, strings and numbers, as `from_dict` takes it."""
        values: dict[str, Any] = plain(asdict(cast("Any", self)))
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], key: str | None = None) -> Self:
        """The settings of plain values; what is left out takes its default.

        Args:
            values: by name; those of a group are a dict.
            key: what the settings are called in messages, such as the config's 'method';
                'DeepRING settings', and so on, by default.

        Raises:
            ConfigError: a name that is no setting, or a value of another type. The message names
                it as ``key.name``.
        """
        name = f"{cls.label} settings".strip() if key is None else key
        settings: Self = typed(cls, values, name, whole=False)
        return settings


class NetworkMethod(nn.Module, ABC):
    """A method that is a network: rasters (b, *raster.shape) in, descriptors out.

    Subclasses name their settings' class, are made of such settings, and define ``forward`` and
    ``compare``; see `deepring.methods.method.Method`.

    Args:
        settings: everything that makes a descriptor but the weights.
        kind: of the raster; another raises ConfigError. None takes any.
    """

    settings_class: ClassVar[type[PlainSettings]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        check_calls(cls)

    def __init__(self, settings: PlainSettings, kind: type[Raster] | None = None) -> None:
        super().__init__()
        self.settings = settings
        self._raster = make_raster(cast("Any", settings).raster)
        if kind is not None:
            of_type(f"{settings.label}: raster", self._raster, kind)

    @classmethod
    def from_fingerprint(cls, made_by: dict[str, Any]) -> Self:
        """The network that a `deepring.evaluation.fingerprint.fingerprint` is of, on 'meta'."""
        settings: Any = made_by.get("settings")  # None is refused
        return cls.without_weights(cls.settings_class.from_dict(settings))

    @classmethod
    def without_weights(cls, settings: PlainSettings) -> Self:
        """The network on the device 'meta'.

        Networks of the package are made there, where weights of any size take no memory; those of
        other classes are moved there, since their constructors may read what they make.
        """
        with torch.device("meta") if registry.is_packaged(cls) else nullcontext():
            return cls(settings).to("meta")

    @property
    def raster(self) -> Raster:
        """The array of a scan that the network takes."""
        return self._raster

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its modules that have weights: what a training may train alone."""
        return tuple(name for name, part in self.named_children() if [*part.parameters()])

    @abstractmethod
    def compare(
        self, queries: Float[Tensor, " q *descriptor"], database: Float[Tensor, " d *descriptor"]
    ) -> Comparison:
        """Compare descriptors (q, ...) with descriptors (d, ...)."""

    def score(
        self, queries: Float[Tensor, " q *descriptor"], database: Float[Tensor, " d *descriptor"]
    ) -> Float[Tensor, "q d"]:
        """The scores of `compare` alone, (q, d)."""
        return self.compare(queries, database).score

    def vectors(
        self, descriptors: Float[Tensor, " batch *descriptor"]
    ) -> Float[Tensor, "batch value"]:
        """Vectors that distance losses compare: (b, ...) -> (b, d); the descriptors themselves."""
        return descriptors.flatten(1)

    @torch.no_grad()
    def describe(self, rasters: Any) -> Float[Tensor, " batch *descriptor"]:
        """`forward` in evaluation mode, on the network's device; descriptors come back on it.

        Whatever is like an array (b, *raster.shape) is taken. Raises DataError for anything else.
        """
        rasters = given_rasters(self.raster, rasters)
        with evaluating(self):
            return self(rasters.to(next(self.parameters()).device))


@contextmanager
def evaluating(network: nn.Module) -> Iterator[None]:
    """Evaluation mode within the block; then each module is in its mode again."""
    training = [module for module in network.modules() if module.training]
    if training:
        network.eval()
    try:
        yield
    finally:
        for module in training:
            module.training = True


def class_path(method: NetworkMethod) -> str:
    """The dotted path of the method's class: what a config's ``_target_`` names it by."""
    return registry.class_path(type(method))


def network_class(path: str) -> type[NetworkMethod]:
    """The class at a dotted path that the user gave, in a config or as an option.

    Raises ConfigError where there is no `NetworkMethod`.
    """
    return as_network(registry.class_at(path))


def as_network(cls: type) -> type[NetworkMethod]:
    """The class. Raises ConfigError where it is no `NetworkMethod`."""
    if not issubclass(cls, NetworkMethod):
        raise ConfigError(
            f"method: {registry.class_path(cls)} learns nothing, expected a NetworkMethod, which "
            "is trained"
        )
    return cls
