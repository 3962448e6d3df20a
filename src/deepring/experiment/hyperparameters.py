"""Hyperparameters of a run for TensorBoard's HPARAMS page."""

from collections.abc import Mapping
from typing import Any

from deepring.paper.flat import flatten
from deepring.paper.paper_values import AGGREGATIONS, INPUTS, LOSSES

Value = bool | str | float | int


def hyperparameters(record: Mapping[str, Any]) -> dict[str, Value]:
    """The values that sweeps vary, under the names of the tables, and the rest under ``more.``.

    The page sorts its columns by name and shows the first five: aggregation, data, encoder,
    input and loss; for methods other than DeepRING data, loss, lr, method and seed.

    Args:
        record: the config of the run, as its ``config.yaml`` holds it.
    """
    method, loss, optimizer = (record[key] or {} for key in ("method", "loss", "optimizer"))
    loss_class = str(loss.get("_target_")).rpartition(".")[2]
    training_data = [node["name"] for node in record["train_data"].values()] or [
        record["data"]["name"]
    ]
    short: dict[str, Value] = {
        "data": "+".join(training_data),
        "loss": LOSSES.get(loss_class, loss_class),
        "lr": optimizer.get("lr", 0.0),
        "method": str(method.get("_target_")).rpartition(".")[2],
        "seed": record["seed"],
        **_of_deepring(method),
        **_of_episodes(record["sampling"] or {}),
    }
    groups = ("method", "loss", "sampling", "augmentation", "optimizer")
    rest = flatten({name: record[name] for name in groups})
    return short | {
        f"more.{key}": value if isinstance(value, Value) else str(value)
        for key, value in rest.items()
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
