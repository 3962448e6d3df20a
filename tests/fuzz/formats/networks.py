"""Networks as exported files and as checkpoints: read, and asked for a descriptor."""

import io
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import torch

from deepring.methods.network_file import (
    TrainedNetwork,
    describe_network,
    load_network,
    weights_of,
    write_network,
)
from deepring.testing import with_columns
from fuzz.decoders import sealed
from fuzz.files import Files, Format, UndecodableError, in_memory, read_back
from fuzz.mutations.raw import raw
from fuzz.mutations.sealed import forged_layout, forged_tensors, forged_values
from fuzz.mutations.values import changed
from fuzz.mutations.zips import zip_entries
from fuzz.scenes import scene
from helpers.tiny_methods import TINY

#: All that learn.
_METHODS = (
    "deepring",
    "disco",
    "pointnetvlad",
    "egonn",
    "locnet",
    "rinet",
    "lcdnet",
    "lpdnet",
    "overlapnet",
    "lcdnet",
    "dh3d",
    "locus",
)
_SCAN = np.array(scene(1), np.float32)


def formats() -> Iterator[Format]:
    """Files and checkpoints of networks."""
    for name in _METHODS:
        values = forged_values("n.safetensors")
        yield Format(
            f"network {name}",
            lambda _, name=name: _network(name),
            (
                *(values, values, values, forged_tensors("n.safetensors")),
                *(forged_layout("n.safetensors"), raw("n.safetensors")),
            ),
            lambda folder: _described(folder / "n.safetensors"),
            _stated,
        )
    zips = zip_entries("n.ckpt")
    yield Format(
        "checkpoint",
        lambda _: {"n.ckpt": _saved(_state())},
        (zips, zips, _forged, _forged, _forged, raw("n.ckpt")),
        lambda folder: _described(folder / "n.ckpt"),
        weight=8,
    )


def _described(path: Path) -> Any:
    """What a network's file states, its weights, and whether it describes a scan."""
    network = load_network(path)
    method = network.method
    with in_memory():
        points = with_columns(_SCAN, method.raster.columns)
        image = torch.from_numpy(np.asarray(method.raster(points, -1.8)))[None]
        descriptor = method.describe(image)
        method.compare(descriptor, descriptor)
    weights = {
        k: v.contiguous().reshape(-1).view(torch.uint8).numpy().tobytes()
        for k, v in weights_of(method).items()
    }
    return {"stated": [network.trained_on, network.loss], "weights": weights}


@cache
def _network(name: str) -> Files:
    with tempfile.TemporaryDirectory() as folder:
        network = TrainedNetwork(TINY[name]().eval(), "campus+city", "CrossEntropy")
        write_network(Path(folder) / "n.safetensors", network)
        return read_back(Path(folder))


def _stated(files: Mapping[str, bytes]) -> Any:
    values, tensors, _ = sealed.decode(files["n.safetensors"], "network")
    try:
        weights = {name: data for name, (_, _, data) in tensors.items()}
        return {"stated": [values["trained_on"], values["loss"]], "weights": weights}
    except KeyError:
        raise UndecodableError("no network") from None


@cache
def _network_state() -> dict[str, Any]:
    network = TINY["deepring"]().eval()
    values = {**describe_network(network), "trained_on": "campus", "loss": "CrossEntropy"}
    return {"values": values, "weights": weights_of(network)}


def _state() -> dict[str, Any]:
    """The part of a checkpoint that is read."""
    state = _network_state()
    return {
        "epoch": 3,
        "pytorch-lightning_version": "2.6.4",
        "state_dict": {f"method.{name}": value for name, value in state["weights"].items()},
        "hyper_parameters": state["values"],
    }


def _saved(state: Any) -> bytes:
    buffer = io.BytesIO()
    torch.save(state, buffer)
    return buffer.getvalue()


def _forged(rng: Random, files: Files) -> str:
    """Other settings or other weights, saved as a checkpoint is."""
    state = _state()
    done = []
    if rng.random() < 0.6:
        state["hyper_parameters"], words = changed(rng, state["hyper_parameters"])
        done.append(words)
    else:
        weights = state["state_dict"]
        name = rng.choice(sorted(weights))
        value = weights[name]
        weights[name] = _other(rng, value)
        if weights[name] is None:
            del weights[name]
        done.append(name)
    if rng.random() < 0.15:
        key = rng.choice(sorted(state))
        state[key] = rng.choice((None, [], {}, 3, "x", torch.zeros(2)))
        done.append(key)
    files["n.ckpt"] = _saved(state)
    return f"n.ckpt: {', '.join(done)}"


def _other(rng: Random, value: Any) -> Any:
    kind = rng.randrange(9)
    if kind == 0:
        return None
    if kind == 1:
        return value.flatten()[:-1] if value.ndim else value[None]
    if kind == 2:
        return value.to(rng.choice((torch.float64, torch.int8, torch.bool, torch.complex64)))
    if kind == 3:
        return rng.choice(([1.0], "x", 3, {"a": 1}, [value]))
    if kind == 4:
        return torch.full_like(value, rng.choice((0, 1)))
    if kind == 5 and value.is_floating_point():
        return torch.full_like(value, rng.choice((float("nan"), float("inf"), 1e38)))
    if kind == 6:
        return value.to_sparse() if value.ndim else value
    if kind == 7:
        return torch.empty(0)
    return torch.empty((10**10,), device="meta")
