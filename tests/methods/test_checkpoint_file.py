"""Checkpoints: what torch wrote is read; a file made on purpose runs, imports and takes nothing."""

import io
import pickle
import resource
import zipfile
from collections import Counter

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import FileError
from deepring.methods.checkpoint_file import read_checkpoint
from deepring.methods.network_file import describe_network, load_network, weights_of
from helpers.marking import MODULE, Mark, Marked
from helpers.tiny_methods import TINY


def state_of(network):
    return {
        "state_dict": {f"method.{name}": value for name, value in weights_of(network).items()},
        "hyper_parameters": {**describe_network(network), "trained_on": "a", "loss": "b"},
        "optimizer_states": [{"state": {0: {"step": torch.tensor(3.0)}}, "param_groups": [{}]}],
        "more": {"milestones": Counter([3, 4]), "dtype": torch.float32, "set": {1}, "raw": b"a"},
    }


@pytest.fixture(scope="module")
def network():
    return TINY["deepring"]().eval()


@pytest.fixture(scope="module")
def saved(network, tmp_path_factory):
    path = tmp_path_factory.mktemp("checkpoints") / "good.ckpt"
    torch.save(state_of(network), path)
    return path


def refused(path, message="is no whole checkpoint of this version"):
    with pytest.raises(FileError, match=message) as raised:
        load_network(path)
    assert str(raised.value).startswith(f"checkpoint {path}: ")
    assert "\n" not in str(raised.value)


def again(saved, path, change=lambda _, data: data, **options):
    """The zip again, with other contents of its entries."""
    with zipfile.ZipFile(saved) as source, zipfile.ZipFile(path, "w", **options) as target:
        for name in source.namelist():
            target.writestr(name, change(name, source.read(name)))
    return path


def with_pickle(saved, path, content):
    """The same, with another pickle in its place."""
    return again(saved, path, lambda n, data: content if n.endswith("data.pkl") else data)


def test_what_was_saved_is_read(saved, network, tmp_path):
    weights = weights_of(load_network(saved).method)
    assert all(torch.equal(weights[name], value) for name, value in weights_of(network).items())
    again(saved, tmp_path / "b.ckpt")
    assert load_network(tmp_path / "b.ckpt").trained_on == "a"


def pickles_of(marker):
    return {
        "reduce": pickle.dumps(Marked(marker), 2),
        "exec": b"cbuiltins\nexec\n(S'import os; os.mkdir(%r)'\ntR." % str(marker).encode(),
        "global of a module": f"c{MODULE}\nAnything\n.".encode(),
        "instance": f"(i{MODULE}\nAnything\n.".encode(),
        "stack global": pickle.dumps(Counter, 4).replace(b"Counter", b"OrderedDict"),
        "bytearray": pickle.dumps({"state_dict": {}, "x": bytearray(9)}, 2),
        "numpy": pickle.dumps({"state_dict": {}, "x": np.float64(1)}, 2),
        "getattr": b"cbuiltins\ngetattr\n(cos\nsystem\nS'x'\ntR.",
        "extension": b"\x82\x01.",
    }


@pytest.mark.parametrize("name", pickles_of("x"))
def test_pickles_that_name_anything_run_and_import_nothing(name, saved, tmp_path):
    mark = Mark(tmp_path)
    path = with_pickle(saved, tmp_path / "bad.ckpt", pickles_of(mark.path)[name])
    with mark.unmarked():
        refused(path)


def test_a_bomb_is_refused_by_what_it_declares(saved, tmp_path):
    bomb = again(saved, tmp_path / "bomb.ckpt", compression=zipfile.ZIP_DEFLATED)
    refused(bomb)
    with zipfile.ZipFile(tmp_path / "large.ckpt", "w", zipfile.ZIP_DEFLATED) as parts:
        with parts.open("archive/data/0", "w") as part:
            for _ in range(64):
                part.write(bytes(2**20))
        parts.writestr("archive/data.pkl", pickle.dumps({}, 2))
    assert (tmp_path / "large.ckpt").stat().st_size < 2**18
    refused(tmp_path / "large.ckpt")


def test_tensors_larger_than_the_file_are_refused(network, tmp_path):
    state = state_of(network)
    for name, value in state["state_dict"].items():
        state["state_dict"][name] = torch.zeros((), dtype=value.dtype).expand(5000, *value.shape)
    torch.save(state, tmp_path / "wide.ckpt")  # all of one number, repeated by its stride
    refused(tmp_path / "wide.ckpt")


def test_a_storage_that_declares_more_than_it_has_is_refused(tmp_path):
    torch.save({"state_dict": {"method.w": torch.zeros(8)}}, tmp_path / "a.ckpt")
    for number in (9, 10**8):
        size = b"J" + number.to_bytes(4, "little")

        def declare_more(name, data, size=size):
            return data.replace(b"K\x08", size) if name.endswith("data.pkl") else data

        refused(again(tmp_path / "a.ckpt", tmp_path / "b.ckpt", declare_more))


@pytest.mark.parametrize(
    ("group", "values"),
    [
        ("encoder", {"widths": [8192] * 3}),
        ("encoder", {"widths": [4] * 10**4}),
        ("encoder", {"convolutions": 10**9}),
        ("representation", {"angles": 10**9}),
        ("raster", {"cells": 10**9}),
        ("raster", {"preprocessing": {"cell": 1e-9}}),
    ],
)
def test_settings_of_a_giant_take_no_memory(group, values, network, tmp_path):
    state = state_of(network)
    settings = state["hyper_parameters"]["settings"]
    settings[group] = {**settings[group], **values}
    torch.save(state, tmp_path / "giant.ckpt")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused(tmp_path / "giant.ckpt", "expected")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.pop("state_dict"), "no whole checkpoint"),
        (lambda s: s.update(state_dict=[1]), "no whole checkpoint"),
        (lambda s: s["state_dict"].update(a=3), "no whole checkpoint"),
        (lambda s: s.pop("hyper_parameters"), "expected 'method' and 'settings'|lacks"),
        (lambda s: s.update(hyper_parameters=3), "lacks"),
        (lambda s: s["hyper_parameters"].update(trained_on=3), r"trained_on: 3, expected text"),
        (lambda s: s["hyper_parameters"].update(loss="\x1b[2J"), r"control characters"),
        (lambda s: s["hyper_parameters"].update(method="os.path"), "not registered"),
        (lambda s: s["hyper_parameters"].update(more=1), "unknown"),
        (lambda s: s["hyper_parameters"].update(settings=None), "settings"),
    ],
)
def test_other_contents_are_refused(change, message, network, tmp_path):
    state = state_of(network)
    change(state)
    torch.save(state, tmp_path / "other.ckpt")
    refused(tmp_path / "other.ckpt", message)


@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_weights_that_are_no_numbers_are_refused(value, network, tmp_path):
    state = state_of(network)
    name = next(k for k, v in state["state_dict"].items() if v.is_floating_point())
    state["state_dict"][name] = torch.full_like(state["state_dict"][name], value)
    torch.save(state, tmp_path / "nan.ckpt")
    refused(tmp_path / "nan.ckpt", "values that are not finite.*diverged")


def test_variances_and_types_of_weights_are_checked(network, tmp_path):
    state = state_of(network)
    variance = next(k for k in state["state_dict"] if k.endswith("running_var"))
    original = state["state_dict"][variance]
    for value, message in ((-original, "variances below 0"), (original.double(), "float64")):
        state["state_dict"][variance] = value
        torch.save(state, tmp_path / "var.ckpt")
        refused(tmp_path / "var.ckpt", message)


def small_checkpoint():
    buffer = io.BytesIO()
    torch.save({"state_dict": {"a": torch.arange(3.0)}, "epoch": 1}, buffer)
    return buffer.getvalue()


@settings(deadline=None, max_examples=200)
@given(data=st.data())
def test_a_flipped_bit_is_refused_or_changes_nothing(tmp_path_factory, data):
    """Also in the headers of the zip, which hold what no checksum covers: times, padding."""
    whole = bytearray(small_checkpoint())
    whole[data.draw(st.integers(0, len(whole) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path = tmp_path_factory.getbasetemp() / "flipped.ckpt"
    path.write_bytes(whole)
    try:
        state = read_checkpoint(path)
    except FileError:
        return
    assert state["epoch"] == 1
    assert torch.equal(state["state_dict"]["a"], torch.arange(3.0))
