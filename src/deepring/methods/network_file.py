"""A trained network and its files: a checkpoint, an exported sealed file, the one in the package.

Lightning is not needed to read them. `shipped_network` is trained on simulated worlds; what it can
do and what it cannot is in docs/model_card.md.
"""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from deepring.errors import ConfigError, DeepringError, FileError
from deepring.io.sealed import SealedFormat, open_sealed, write_sealed
from deepring.methods.network import NetworkMethod, as_network
from deepring.methods.registry import method_class, method_name

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


@dataclass(frozen=True)
class _NetworkHeader:
    """The header of a network's file."""

    network: dict[str, Any]
    """As `describe_network` describes it."""
    trained_on: str
    loss: str


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
    """
    if str(checkpoint) == SHIPPED:
        return shipped_network()
    path = Path(checkpoint)
    if path.suffix == ".safetensors":
        return read_network(path, own_class)
    if not path.is_file():
        raise FileError(
            f"checkpoint {path}: is no file; give the .ckpt of a run, such as "
            "outputs/demo/latest/checkpoints/best.ckpt"
        )
    try:
        with zipfile.ZipFile(path) as parts:
            altered = parts.testzip()  # torch.load itself compares no checksums
        if altered is not None:
            raise zipfile.BadZipFile(altered)
        state = torch.load(path, map_location="cpu", weights_only=True)
        values = state["hyper_parameters"]
        weights = {
            name.removeprefix("method."): value
            for name, value in state["state_dict"].items()
            if name.startswith("method.")
        }
        trained_on, loss = str(values["trained_on"]), str(values["loss"])
    except Exception as error:  # damaged files and other ones fail in many ways
        raise FileError(
            f"checkpoint {path}: is no whole checkpoint of this version: another file, or cut "
            "short or altered; copy it again, take another, or delete it to train anew"
        ) from error
    try:
        return TrainedNetwork(make_network(values, weights, own_class), trained_on, loss)
    except DeepringError as error:
        raise FileError(f"checkpoint {path}: {error}") from error


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
    network of this version.
    """
    try:
        name, settings = str(described["method"]), dict(described["settings"])
    except (KeyError, TypeError, ValueError):
        raise ConfigError(
            f"network: described by {described!r}, expected 'method' and 'settings'; take a "
            "network of this version of deepring, or train again"
        ) from None
    kind = as_network(method_class(name, own_class))
    try:
        method = kind(kind.settings_class.from_dict(settings))
        method.load_state_dict(dict(weights))
    except DeepringError:
        raise
    except Exception as error:  # settings of other types fail wherever a layer meets them
        raise ConfigError(
            f"network: the weights are not those of {name!r} with settings {settings}; expected "
            "the settings and weights that one network had"
        ) from error
    return method.eval()
