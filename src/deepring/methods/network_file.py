"""A trained network as one sealed file; Lightning is not needed to read it.

`shipped_network` is the one that comes with the package, trained on simulated worlds; what it can
do and what it cannot is in docs/model_card.md.
"""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from deepring.io.sealed import SealedFormat, open_sealed, write_sealed
from deepring.methods.network import NetworkMethod
from deepring.methods.portable import describe_network, make_network, weights_of

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
class NetworkHeader:
    """What a file says of its network."""

    network: dict[str, Any]
    """As `describe_network` describes it."""
    trained_on: str
    loss: str


FORMAT = SealedFormat(
    "network",
    2,
    NetworkHeader,
    {"*": None},
    description="a network as `deepring export` writes it",
    remedy="export it again",
)


def write_network(path: Path, network: TrainedNetwork) -> None:
    """Write a network, whole or not at all."""
    header = NetworkHeader(describe_network(network.method), network.trained_on, network.loss)
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
