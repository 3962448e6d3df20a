"""Sealed files taken apart and put together again, without the package's own writer."""

import hashlib
import json

import torch
from safetensors import safe_open
from safetensors.torch import save_file


def parts_of(path):
    """What a file's header states, and its tensors."""
    with safe_open(path, framework="pt") as file:
        tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
        return json.loads(file.metadata()["deepring_sealed"].partition("\n")[2]), tensors


def entry_of(tensor):
    """What a header states of a tensor."""
    data = tensor.contiguous().reshape(-1).view(torch.uint8).numpy().tobytes()
    return {
        "dtype": str(tensor.dtype).removeprefix("torch."),
        "shape": list(tensor.shape),
        "sha256": hashlib.sha256(data).hexdigest(),
    }


def put_together(path, stated, tensors):
    """A file whose seal is whole, whatever it states; its header may be text, too."""
    text = stated if isinstance(stated, str) else json.dumps(stated)
    digest = hashlib.sha256(text.encode()).hexdigest()
    tensors = {name: tensor.contiguous() for name, tensor in tensors.items()}
    save_file(tensors, path, {"deepring_sealed": f"{digest}\n{text}"})
    return path


def rewritten(path, values=(), stated=(), tensors=(), lacking=()):
    """The file again with other values, statements or tensors, or without those named."""
    old, whole = parts_of(path)
    whole = {k: v for k, v in {**whole, **dict(tensors)}.items() if k not in lacking}
    changed = {**old["values"], **dict(values)}
    old["values"] = {key: value for key, value in changed.items() if key not in lacking}
    old["tensors"] = {name: entry_of(tensor) for name, tensor in whole.items()}
    everything = {k: v for k, v in {**old, **dict(stated)}.items() if k not in lacking}
    return put_together(path, everything, whole)
