"""Annotated shapes are checked in these tests, and only there."""

import importlib.util
import inspect
import pkgutil
import typing
from pathlib import Path

import jaxtyping
import pytest
import torch
from torch import Tensor

import deepring.core
import deepring.nn
import deepring.search
from deepring.core import similarity
from deepring.core.correlation import correlation_curves, unit_norm
from deepring.nn.circular import CircularConv2d, circular_pad


@pytest.mark.parametrize(
    "call",
    [
        lambda: unit_norm(torch.zeros(3)),
        lambda: correlation_curves(torch.zeros(2, 12, 5), torch.zeros(3, 12, 6)),
        lambda: circular_pad(torch.zeros(12, 6), 1),
        lambda: CircularConv2d(2, 1)(torch.zeros(12, 6)),
        lambda: similarity.cosine(torch.zeros(2, 3, dtype=torch.int64), torch.zeros(2, 3)),
    ],
    ids=["axes", "lengths", "batch", "module", "dtype"],
)
def test_other_shapes_are_refused_while_tests_run(call):
    with pytest.raises(jaxtyping.TypeCheckError):
        call()


def test_nothing_is_checked_otherwise():
    # The same file, imported past the hook that pytest installs.
    spec = importlib.util.spec_from_file_location("unchecked", Path(similarity.__file__))
    unchecked = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(unchecked)
    integers = torch.ones(2, 3, dtype=torch.int64)
    assert unchecked.cosine(integers, integers).shape == (2, 2)
    assert not hasattr(unchecked.cosine, "__wrapped__")
    assert hasattr(similarity.cosine, "__wrapped__")


def functions():
    """Public functions and methods of the checked packages."""
    for package in (deepring.core, deepring.nn, deepring.search):
        for info in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
            if info.name.rpartition(".")[2].startswith("_"):
                continue
            module = importlib.import_module(info.name)
            for name, value in vars(module).items():
                if getattr(value, "__module__", None) != info.name or name.startswith("_"):
                    continue
                if inspect.isfunction(value):
                    yield f"{info.name}.{name}", value
                elif inspect.isclass(value):
                    yield from (
                        (f"{info.name}.{name}.{method}", function)
                        for method, function in vars(value).items()
                        if inspect.isfunction(function) and not method.startswith("_")
                    )


def test_every_tensor_of_a_public_function_has_its_axes_named():
    bare, named = [], 0
    for name, function in functions():
        for hint in typing.get_type_hints(function).values():
            bare += [name] if hint is Tensor else []
            named += isinstance(hint, type) and issubclass(hint, jaxtyping.AbstractArray)
    assert not bare
    assert named > 90
