"""A trained network out of a checkpoint, an exported file, or the package. Lightning not needed."""

from pathlib import Path

import torch

from deepring.errors import DeepringError
from deepring.methods.network import network_class
from deepring.methods.network_file import SHIPPED, TrainedNetwork, read_network, shipped_network


def load_network(checkpoint: Path | str) -> TrainedNetwork:
    """The network of a checkpoint or of an exported .safetensors file, on the CPU; 'shipped' is
    the one that comes with the package.

    Raises DeepringError where the file is missing or holds no checkpoint of a method.
    """
    if str(checkpoint) == SHIPPED:
        return shipped_network()
    path = Path(checkpoint)
    if path.suffix == ".safetensors":
        return read_network(path)
    if not path.is_file():
        raise DeepringError(
            f"checkpoint: {path} is no file; give the .ckpt of a run, such as "
            "outputs/demo/latest/checkpoints/best.ckpt"
        )
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
        kept = state["hyper_parameters"]
        weights = {
            name.removeprefix("method."): value
            for name, value in state["state_dict"].items()
            if name.startswith("method.")
        }
        kind = network_class(kept["method"])
        method = kind(kind.settings_class.from_dict(kept["settings"]))
        method.load_state_dict(weights)
    except DeepringError:
        raise
    except Exception as error:  # torch.load raises many kinds for a damaged file
        raise DeepringError(
            f"checkpoint: {path} is no whole checkpoint of this version "
            f"({type(error).__name__}); take another, or delete it to train anew"
        ) from error
    return TrainedNetwork(method.eval(), str(kept["trained_on"]), str(kept["loss"]))
