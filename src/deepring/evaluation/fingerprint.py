"""Fingerprints of methods, by which files of descriptors are compared."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from deepring.data.cache import RASTER_VERSION
from deepring.errors import DataError
from deepring.io.typed import plain
from deepring.methods.method import Method
from deepring.methods.registry import method_name
from deepring.rasters import RASTERS, raster_settings


def fingerprint(method: Method) -> dict[str, Any]:
    """Everything that determines a method's descriptors, as plain values.

    These are the method's name and the settings of its raster; for a network also its
    ``settings`` and a SHA-256 over its weights; for another method also its public attributes,
    with a SHA-256 in place of each array. Attributes with a leading underscore do not count. A
    network on the device 'meta' has no weights, and its fingerprint has none.
    `deepring.methods.method.rebuild_method` rebuilds a method from it.

    Raises:
        DataError: a raster that is not in `RASTERS`, a network without settings, or an attribute
            that is not a plain value.
    """
    name = method_name(type(method))
    raster = method.raster
    if type(raster) not in RASTERS.values():
        raise DataError(
            f"{name}: raster {type(raster).__name__}, expected one of {', '.join(RASTERS)}; "
            "descriptors of other rasters cannot be exported"
        )
    made_by = {
        "method": name,
        "raster": raster_settings(raster),
        "raster_version": RASTER_VERSION,
    }
    if not isinstance(method, nn.Module):
        public = {k: v for k, v in vars(method).items() if k != "raster" and not k.startswith("_")}
        made_by["values"] = plain(dict(sorted(public.items())), _plain_leaf, name)
        return json_copy(made_by)
    settings: Any = getattr(method, "settings", None)
    if not hasattr(settings, "to_dict"):
        raise DataError(
            f"{name}: settings {settings!r}, expected PlainSettings, as every NetworkMethod has; "
            "descriptors of other networks cannot be exported"
        )
    made_by["settings"] = settings.to_dict()
    weights = {k: v for k, v in method.state_dict().items() if isinstance(v, Tensor)}
    if not any(weight.is_meta for weight in weights.values()):
        made_by["weights"] = digest_of(weights)
    return json_copy(made_by)


def first_difference(ours: Any, theirs: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """The first dotted key at which two fingerprints differ, and both values; None if equal.

    A key that is missing in one of them has the value None there.
    """
    if not (isinstance(ours, dict) and isinstance(theirs, dict)):
        return None if ours == theirs else (key, ours, theirs)
    for name in dict.fromkeys([*ours, *theirs]):
        inner = f"{key}.{name}" if key else name
        difference = first_difference(ours.get(name), theirs.get(name), inner)
        if difference is not None:
            return difference
    return None


def digest_of(arrays: Mapping[str, Tensor | NDArray[Any]]) -> str:
    """SHA-256 over names, types, shapes and bytes, in the order of the names."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        kind = str(array.dtype).removeprefix("torch.")
        digest.update(json.dumps([name, kind, list(array.shape)]).encode())
        digest.update(_raw(array).data)
    return digest.hexdigest()


def _raw(array: Tensor | NDArray[Any]) -> NDArray[np.uint8]:
    """The bytes of an array or of a tensor on any device."""
    if isinstance(array, Tensor):
        return array.detach().cpu().reshape(-1).view(torch.uint8).numpy()
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8)


def json_copy(values: dict[str, Any]) -> dict[str, Any]:
    """The values as JSON gives them back, with lists for sequences. Raises DataError on others."""
    try:
        copy = json.loads(json.dumps(values))
    except (TypeError, ValueError):
        raise DataError(f"made_by: {values!r}, expected plain values") from None
    if not isinstance(copy, dict):
        raise DataError(f"made_by: {copy!r}, expected a dict, as fingerprint() gives")
    return copy


def _plain_leaf(where: str, value: Any) -> Any:
    """The value, where JSON can hold it; an array's hash. Raises DataError on others."""
    if isinstance(value, Tensor) or (isinstance(value, np.ndarray) and value.dtype != object):
        return {"sha256": digest_of({"": value})}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise DataError(
        f"{where}: a {type(value).__name__}, expected a plain value; if it has no effect on the "
        "descriptors, begin its name with an underscore"
    )
