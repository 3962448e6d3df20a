"""Checkpoints of a training, as torch writes them: a zip of one pickle and the bytes of tensors.

A pickle is a program. torch's reader runs a small part of that language, and no code of the file;
before it sees one, the file is checked for what that reader does not check.
"""

import codecs
import pickletools
import warnings
import zipfile
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from deepring.errors import FileError
from deepring.methods.registry import registered_methods

#: What the pickle of a checkpoint may name, other than storages of numbers: collections, tensors,
#: and their types. torch's reader takes more, such as a bytearray of any length.
_NAMES = {
    "collections OrderedDict",
    "collections Counter",  # milestones of a schedule
    "__builtin__ set",
    "_codecs encode",  # bytes
    "torch Size",
    "torch device",
    "torch._utils _rebuild_tensor_v2",
    "torch._utils _rebuild_parameter",
    *(str(value).replace(".", " ") for value in vars(torch).values() if type(value) is torch.dtype),
}

_NUMBERS = ("BFloat16", "Bool", "Byte", "Char", "Double", "Float", "Half", "Int", "Long", "Short")
_STORAGES = {f"torch {kind}Storage" for kind in _NUMBERS}


class _NotWholeError(Exception):
    """A file that holds no checkpoint."""


def read_checkpoint(path: Path) -> dict[str, Any]:
    """The values of a checkpoint, with tensors on the CPU.

    Nothing in the file is executed or imported, and what its tensors take is at most its size.
    Raises FileError for anything but a whole checkpoint.
    """
    if not path.exists() and str(path) in registered_methods():
        raise FileError(
            f"checkpoint {path}: the name of a method, expected the .ckpt of a run; `deepring "
            f"train method={path}` makes one, and evaluates a method that has none"
        )
    if not path.is_file():
        raise FileError(
            f"checkpoint {path}: is no file; give the .ckpt of a run, such as "
            "outputs/demo/latest/checkpoints/best.ckpt"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is loaded is checked
            held = _check_parts(path)
            torch.serialization.add_safe_globals([set, codecs.encode])  # unknown to torch 2.4
            state = torch.load(path, map_location="cpu", weights_only=True)
        _check_state(state, path.stat().st_size, held)
    except Exception as error:  # damaged files and other ones fail in many ways
        raise FileError(
            f"checkpoint {path}: is no whole checkpoint of this version: another file, or cut "
            "short or altered; copy it again, take another, or delete it to train anew"
        ) from error
    whole: dict[str, Any] = state
    return whole


def _check_parts(path: Path) -> int:
    """Raise an exception unless the zip is whole, and its parts are as large as they say.

    Returns the bytes of those that hold numbers.
    """
    with zipfile.ZipFile(path) as parts:
        entries = parts.infolist()
        names = [entry.filename for entry in entries]
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
            raise _NotWholeError("compressed")
        if sum(entry.file_size for entry in entries) > path.stat().st_size:
            raise _NotWholeError("larger than the file")
        if len(set(names)) < len(names) or parts.testzip() is not None:
            raise _NotWholeError("altered")  # torch.load itself compares no checksums
        (pickle,) = (name for name in names if name.endswith("/data.pkl"))
        _check_pickle(parts.read(pickle))
        return sum(entry.file_size for entry in entries if "/data/" in entry.filename)


def _check_pickle(content: bytes) -> None:
    """Raise an exception if the pickle names anything but numbers, texts, dicts and tensors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of texts that are not as torch writes them
        operations = list(pickletools.genops(content))
    for operation, argument, _ in operations:
        if operation.name in ("STACK_GLOBAL", "INST", "OBJ", "NEWOBJ_EX", "EXT1", "EXT2", "EXT4"):
            raise _NotWholeError(operation.name)
        if operation.name == "GLOBAL" and argument not in _NAMES | _STORAGES:
            raise _NotWholeError(str(argument))


def _check_state(state: Any, size: int, held: int) -> None:
    """Raise an exception unless the weights are tensors with as many bytes as the file at most.

    ``held`` are the bytes of its parts that hold numbers.
    """
    if not isinstance(state, dict) or not isinstance(state.get("state_dict"), dict):
        raise _NotWholeError("no state_dict")
    tensors = state["state_dict"].values()
    if not all(isinstance(tensor, Tensor) for tensor in tensors):
        raise _NotWholeError("a state_dict of other values")
    if sum(tensor.numel() * tensor.element_size() for tensor in tensors) > size:
        raise _NotWholeError("tensors larger than the file")
    storages = {one.data_ptr(): one.nbytes() for one in map(Tensor.untyped_storage, tensors)}
    if sum(storages.values()) > held:
        raise _NotWholeError("storages larger than their parts")  # torch 2.4 would enlarge them
