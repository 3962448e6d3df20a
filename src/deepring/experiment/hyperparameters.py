"""What TensorBoard's HPARAMS page tells runs apart by."""

from deepring.experiment import build
from deepring.experiment.config import Config, flattened
from deepring.paper.paper_values import AGGREGATIONS, INPUTS, LOSSES

Value = bool | str | float | int


def hyperparameters(cfg: Config) -> dict[str, Value]:
    """The tables' names for what sweeps vary, and the rest of the groups under ``more.``.

    The page sorts its columns by name and shows the first five: aggregation, data, encoder,
    input and loss; for methods other than DeepRING data, loss, lr, method and seed.
    """
    loss, optimizer = build.plain(cfg.loss) or {}, build.plain(cfg.optimizer) or {}
    own_loss = str(loss.get("_target_")).rpartition(".")[2]
    method = build.plain(cfg.method) or {}
    trained = [config.name for config in cfg.train_data.values()] or [cfg.data.name]
    short: dict[str, Value] = {
        "data": "+".join(trained),
        "loss": LOSSES.get(own_loss, own_loss),
        "lr": optimizer.get("lr", 0.0),
        "method": str(method.get("_target_")).rpartition(".")[2],
        "seed": cfg.seed,
        **_of_deepring(cfg),
    }
    groups = (
        *("method", "representation", "encoder", "similarity", "loss", "sampling"),
        "optimizer",
    )
    rest = flattened({name: build.plain(getattr(cfg, name)) for name in groups})
    return short | {
        f"more.{key}": value if isinstance(value, Value) else str(value)
        for key, value in rest.items()
        if value is not None
    }


def _of_deepring(cfg: Config) -> dict[str, Value]:
    """What makes a DeepRING; empty for other methods."""
    r, e, a, s = cfg.representation, cfg.encoder, cfg.aggregation, cfg.similarity
    if r is None or e is None or a is None or s is None:
        return {}
    raster = str(r.raster["kind"])
    widths = "-".join(str(width) for width in e.widths)
    own: dict[str, Value] = {
        "aggregation": AGGREGATIONS.get(a.kind, a.kind),
        "encoder": f"{widths} x{e.convolutions}" + (f", stem {e.stem}" if e.stem > 1 else ""),
        "input": INPUTS.get(raster, raster),
        "similarity": s.kind,
    }
    sampling = build.plain(cfg.sampling) or {}
    return own | {name: sampling[name] for name in ("ways", "shots", "queries") if name in sampling}
