"""A trained network as plain values and tensors, to travel in a file without Lightning."""

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from deepring.errors import ConfigError, DeepringError
from deepring.methods.network import NetworkMethod, as_network
from deepring.methods.registry import method_class, method_name


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
