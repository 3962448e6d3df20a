"""A trained network and its files: a checkpoint, an exported sealed file, the one in the package.

Lightning is not needed to read them. `shipped_network` is trained on simulated worlds; what it can
do and what it cannot is in docs/model_card.md.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from deepring.errors import ConfigError, DeepringError, FileError
from deepring.io.sealed import SealedFormat, open_sealed, write_sealed
from deepring.io.typed import typed
from deepring.methods.checkpoint_file import read_checkpoint
from deepring.methods.network import NetworkMethod, as_network
from deepring.methods.registry import method_class, method_name
from deepring.text import shown

log = logging.getLogger(__name__)

#: What stands for the shipped network where a checkpoint is asked for.
SHIPPED = "shipped"


class TrainedNetwork(NamedTuple):
    """A network and where it comes from."""

    method: NetworkMethod
    """In evaluation mode, with the preprocessing it was trained with."""
    trained_on: str
    """Names of the training datasets, joined by '+'."""
    loss: str
    """Class name of the loss."""
    untrained: tuple[str, ...] = ()
    """Its parts that no training has trained, where a checkpoint tells; see
    `deepring.methods.network.NetworkMethod.parts`. An exported file does not tell."""


@dataclass(frozen=True)
class _NetworkHeader:
    """The header of a network's file."""

    network: dict[str, Any]
    """As `describe_network` describes it."""
    trained_on: str
    loss: str

    def __post_init__(self) -> None:
        for name, text in (("trained_on", self.trained_on), ("loss", self.loss)):
            if not text.isprintable():
                raise ConfigError(
                    f"{name}: {shown(text)}, expected text without control characters"
                )


FORMAT = SealedFormat(
    "network",
    2,
    _NetworkHeader,
    {"*": None},
    description="a network as `deepring export` writes it",
    remedy="export it again",
)


def load_network(checkpoint: Path | str, own_class: str | type | None = None) -> TrainedNetwork:
    """The network of a checkpoint, on the CPU, in evaluation mode.

    Args:
        checkpoint: a .ckpt, an exported .safetensors file, or 'shipped', which is the network
            that comes with the package.
        own_class: the user's class, or its dotted path, where the checkpoint is of a method that
            is not registered; the checkpoint has to name it.

    Raises:
        FileError: a file that is missing, that holds no whole checkpoint of this version, or one
            of a method that is not registered and is not ``own_class``.

    Warns of parts that were never trained.
    """
    network = load_stage(checkpoint, own_class)
    if network.untrained:
        log.warning(
            "checkpoint %s: of %s the parts %s were not trained, and hold random weights",
            checkpoint,
            network.method.settings.label,
            ", ".join(network.untrained),
        )
    return network


def load_stage(checkpoint: Path | str, own_class: str | type | None = None) -> TrainedNetwork:
    """`load_network` for going on with the training, without a warning of what is untrained."""
    if str(checkpoint) == SHIPPED:
        return shipped_network()
    path = Path(checkpoint)
    if path.suffix == ".safetensors":
        return read_network(path, own_class)
    state = read_checkpoint(path)
    try:
        values = _header_of(state)
        untrained = typed(tuple[str, ...], values.pop("untrained", []), "checkpoint.untrained")
        values.pop("trained_parts", None)
        header = typed(_NetworkHeader, values, "checkpoint")
        method = make_network(header.network, _weights_in(state), own_class)
    except DeepringError as error:
        raise FileError(f"checkpoint {path}: {error}") from error
    untrained = tuple(part for part in method.parts if part in untrained)
    return TrainedNetwork(method, header.trained_on, header.loss, untrained)


def _header_of(state: dict[str, Any]) -> dict[str, Any]:
    """What a checkpoint states, as the header of an exported file."""
    values = state.get("hyper_parameters")
    values = dict(values) if isinstance(values, Mapping) else {}
    network = {name: values.pop(name) for name in ("method", "settings") if name in values}
    return {"network": network, **values}


def _weights_in(state: dict[str, Any]) -> dict[str, Tensor]:
    """The network's tensors of a checkpoint by name."""
    tensors = state.get("state_dict")
    tensors = tensors if isinstance(tensors, Mapping) else {}
    named = {str(name): value for name, value in tensors.items() if isinstance(value, Tensor)}
    return {
        name.removeprefix("method."): value
        for name, value in named.items()
        if name.startswith("method.")
    }


def write_network(path: Path, network: TrainedNetwork) -> None:
    """Write a network, whole or not at all."""
    header = _NetworkHeader(describe_network(network.method), network.trained_on, network.loss)
    write_sealed(path, FORMAT, header, weights_of(network.method))


def read_network(path: Path, own_class: str | type | None = None) -> TrainedNetwork:
    """Read what `write_network` wrote, every byte verified; ``own_class`` as in `make_network`.

    Raises FileError for anything else.
    """
    file = open_sealed(path, FORMAT, check=True)
    with file.contents():
        method = make_network(file.header.network, file.tensors, own_class)
    return TrainedNetwork(method, file.header.trained_on, file.header.loss)


def shipped_network() -> TrainedNetwork:
    """The network that comes with the package."""
    return read_network(Path(str(files("deepring.methods") / "weights" / "deepring.safetensors")))


def describe_network(method: NetworkMethod) -> dict[str, Any]:
    """Name and settings: all that makes its descriptors but the weights."""
    return {"method": method_name(type(method)), "settings": method.settings.to_dict()}


def weights_of(method: NetworkMethod) -> dict[str, Tensor]:
    """The weights by name, on the CPU."""
    return {name: value.detach().cpu() for name, value in method.state_dict().items()}


def make_network(
    described: Mapping[str, Any],
    weights: Mapping[str, Tensor],
    own_class: str | type | None = None,
) -> NetworkMethod:
    """The network again, in evaluation mode.

    Args:
        described: name and settings, as `describe_network` gives them.
        weights: by name, as `weights_of` gives them.
        own_class: the class of a method that is not registered, or its dotted path, from the
            user; see `deepring.methods.registry.method_class`.

    Raises ConfigError for a name that is not registered, and for values that are not those of one
    network of this version. Names, types and shapes are compared before memory is taken.
    """
    name, settings = described.get("method"), described.get("settings")
    if not isinstance(name, str) or not isinstance(settings, dict):
        raise ConfigError(
            f"network: described by {shown(described)}, expected 'method' and 'settings'; take a "
            "network of this version of deepring, or train again"
        )
    kind = as_network(method_class(name, own_class))
    stated = kind.settings_class.from_dict(settings)
    expect_weights(kind.without_weights(stated), weights)  # before any memory is taken
    method = kind(stated)
    method.load_state_dict(dict(weights))
    return method.eval()


def expect_weights(network: NetworkMethod, weights: Mapping[str, Tensor]) -> None:
    """Raise ConfigError unless the weights are those of such a network, and finite."""
    expected = {name: (w.dtype, tuple(w.shape)) for name, w in network.state_dict().items()}
    present = {name: (w.dtype, tuple(w.shape)) for name, w in weights.items()}
    if other := sorted(k for k in expected | present if expected.get(k) != present.get(k)):
        name = other[0]
        raise ConfigError(
            f"network: the weights are not those of {network.settings.label} with these settings: "
            f"{shown(name)} is {_kind(present.get(name))}, expected {_kind(expected.get(name))}; "
            f"{len(other)} differ; expected the settings and weights that one network had"
        )
    for name, weight in weights.items():
        if not bool(weight.isfinite().all()):
            raise ConfigError(
                f"network: weight {name}: values that are not finite, expected numbers; take a "
                "checkpoint from before its training diverged"
            )
        if name.endswith("running_var") and bool((weight < 0).any()):
            raise ConfigError(f"network: weight {name}: variances below 0, expected at least 0")


def _kind(weight: tuple[torch.dtype, tuple[int, ...]] | None) -> str:
    return "missing" if weight is None else f"{weight[0]} {list(weight[1])}".removeprefix("torch.")
