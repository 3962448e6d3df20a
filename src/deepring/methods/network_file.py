"""A trained network as one safetensors file: nothing in it is executed, Lightning not needed.

`shipped_network` is the one that comes with the package, trained on simulated worlds; what it can
do and what it cannot is in docs/model_card.md.
"""

import json
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from safetensors import SafetensorError, safe_open

from deepring.errors import DeepringError
from deepring.io.files import write_tensors
from deepring.methods.network import NetworkMethod
from deepring.methods.portable import describe_network, make_network, weights_of

#: Raise when what a file holds, or what it means, changes.
FORMAT_VERSION = 1

#: What stands for the shipped network where a checkpoint is asked for.
SHIPPED = "shipped"

_KEY = "deepring_network"


class TrainedNetwork(NamedTuple):
    """A network and where it comes from."""

    method: NetworkMethod
    """In evaluation mode, with the preprocessing it was trained with."""
    trained_on: str
    """Names of the training datasets, joined by '+'."""
    loss: str
    """Class name of the loss."""


def write_network(path: Path, network: TrainedNetwork) -> None:
    """Write a network, whole or not at all."""
    about = {
        "version": FORMAT_VERSION,
        "network": describe_network(network.method),
        "trained_on": network.trained_on,
        "loss": network.loss,
    }
    write_tensors(path, weights_of(network.method), {_KEY: json.dumps(about, sort_keys=True)})


def read_network(path: Path, own_class: type | str | None = None) -> TrainedNetwork:
    """Read what `write_network` wrote; ``own_class`` is that of `make_network`.

    Raises DeepringError for a file that is missing, no network, cut short, or of another version.
    """
    wanted = "expected a network as `deepring export CHECKPOINT -o FILE.safetensors` writes it"
    if not path.is_file():
        raise DeepringError(f"checkpoint: {path} is no file; {wanted}")
    try:
        with safe_open(path, framework="pt") as file:
            about = json.loads((file.metadata() or {})[_KEY])
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        version = about["version"]
    except (SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        raise DeepringError(
            f"checkpoint: {path} is no whole network ({error}); {wanted}"
        ) from error
    if version != FORMAT_VERSION:
        raise DeepringError(
            f"checkpoint: {path} has format version {version!r}, expected {FORMAT_VERSION}; export "
            "it again with this version of deepring"
        )
    method = make_network(about["network"], weights, own_class)
    return TrainedNetwork(method, str(about["trained_on"]), str(about["loss"]))


def shipped_network() -> TrainedNetwork:
    """The network that comes with the package."""
    return read_network(Path(str(files("deepring.methods") / "weights" / "deepring.safetensors")))
