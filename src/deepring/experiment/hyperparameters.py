"""Hyperparameters of a run for TensorBoard's HPARAMS page."""

import re
from collections.abc import Mapping
from typing import Any

from deepring.paper.flat import flatten
from deepring.paper.paper_values import AGGREGATIONS, INPUTS, LOSSES

Value = bool | str | float | int

#: What one compares runs by, and its type; the page shows the first five.
INTEREST: dict[str, type] = {
    **{"method": str, "loss": str, "ways": float, "seed": float, "data": str, "lr": float},
    **{"encoder": str, "input": str, "aggregation": str, "similarity": str, "polar": str},
    **{"shots": float, "queries": float},
}

#: Keys that `INTEREST` has under a shorter name, and names that change nothing.
_SAID = re.compile(
    r"method\.(_target_|label|note)|loss\._target_|optimizer\.lr|sampling\.(ways|shots|queries)"
)


def hyperparameters(record: Mapping[str, Any]) -> dict[str, Value]:
    """The values that sweeps vary (`INTEREST`), under the names of the tables.

    The rest of what a training depends on is under ``more.``. What a run that learns nothing has as
    ``data`` is what it was tested on.

    Args:
        record: the config of the run, as its ``config.yaml`` holds it.
    """
    method, loss, optimizer = (record[key] or {} for key in ("method", "loss", "optimizer"))
    loss_class = str(loss.get("_target_")).rpartition(".")[2]
    datasets = record["train_data"] or record["test_data"] or {"": record["data"]}
    short: dict[str, Value] = {
        "data": "+".join(node["name"] for node in datasets.values()),
        **({"loss": LOSSES.get(loss_class, loss_class)} if loss else {}),
        **({"lr": optimizer["lr"]} if "lr" in optimizer else {}),
        "method": method.get("label") or str(method.get("_target_")).rpartition(".")[2],
        "seed": record["seed"],
        **_of_deepring(method),
        **_of_episodes(record["sampling"] or {}),
    }
    groups = ("method", "loss", "sampling", "augmentation", "optimizer")
    rest = flatten({name: record[name] for name in groups})
    return short | {
        f"more.{key}": value if isinstance(value, Value) else str(value)
        for key, value in rest.items()
        if not _SAID.fullmatch(key)
    }


def _of_deepring(method: Mapping[str, Any]) -> dict[str, Value]:
    """The choices of a DeepRING; empty for other methods."""
    if "representation" not in method:
        return {}
    raster, encoder, aggregation = method["raster"], method["encoder"], method["aggregation"]
    widths = "-".join(str(width) for width in encoder["widths"])
    stem = f", stem {encoder['stem']}" if encoder["stem"] > 1 else ""
    return {
        "aggregation": AGGREGATIONS.get(aggregation["kind"], aggregation["kind"]),
        "encoder": f"{widths} x{encoder['convolutions']}{stem}",
        "input": INPUTS.get(raster["kind"], raster["kind"]),
        "similarity": method["similarity"]["kind"],
        **_of_polar(method.get("polar")),
    }


def _of_polar(polar: Mapping[str, Any] | None) -> dict[str, Value]:
    """The second look beside the sinogram, where there is one."""
    if polar is None:
        return {}
    widths = "-".join(str(width) for width in polar["widths"])
    return {"polar": f"{widths} x{polar['convolutions']}, share {polar['share']:g}"}


def _of_episodes(episode: Mapping[str, Any]) -> dict[str, Value]:
    return {name: episode[name] for name in ("ways", "shots", "queries") if name in episode}
