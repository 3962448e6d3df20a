"""A trained network as plain values and tensors, to travel in a file without Lightning."""

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from deepring.errors import DeepringError
from deepring.methods.network import NetworkMethod, class_path, network_class


def describe_network(method: NetworkMethod) -> dict[str, Any]:
    """Class and settings: all that makes its descriptors but the weights."""
    return {"class": class_path(method), "settings": method.settings.to_dict()}


def weights_of(method: NetworkMethod) -> dict[str, Tensor]:
    """The weights by name, on the CPU."""
    return {name: value.detach().cpu() for name, value in method.state_dict().items()}


def make_network(described: Mapping[str, Any], weights: Mapping[str, Tensor]) -> NetworkMethod:
    """The network again, in evaluation mode. Raises DeepringError where the two do not fit."""
    try:
        kind = network_class(described["class"])
        method = kind(kind.settings_class.from_dict(dict(described["settings"])))
        method.load_state_dict(dict(weights))
    except (KeyError, TypeError, RuntimeError) as error:
        raise DeepringError(
            f"network: {error}; expected the class, settings and weights that one network had"
        ) from error
    return method.eval()
