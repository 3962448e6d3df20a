"""A trained network out of a checkpoint, an exported file, or the package. Lightning not needed."""

import zipfile
from pathlib import Path

import torch

from deepring.errors import DeepringError, FileError
from deepring.methods.network_file import SHIPPED, TrainedNetwork, read_network, shipped_network
from deepring.methods.portable import make_network


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
