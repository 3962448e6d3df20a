"""What TensorBoard's HPARAMS page tells runs apart by."""

from deepring.evaluation.paper import AGGREGATIONS, INPUTS, LOSSES
from deepring.experiment import build
from deepring.experiment.config import Config, flattened

Value = bool | str | float | int


def hyperparameters(cfg: Config) -> dict[str, Value]:
    """The tables' names for what sweeps vary, and the rest of the groups under ``more.``.

    The page sorts its columns by name and shows the first five: aggregation, data, encoder,
    input and loss.
    """
    r, e = cfg.representation, cfg.encoder
    loss = build.plain(cfg.loss) or {}
    optimizer = build.plain(cfg.optimizer) or {}
    raster, own_loss = str(r.raster["kind"]), str(loss.get("_target_")).rpartition(".")[2]
    widths = "-".join(str(width) for width in e.widths)
    short: dict[str, Value] = {
        "aggregation": AGGREGATIONS.get(cfg.aggregation.kind, cfg.aggregation.kind),
        "data": cfg.data.name,
        "encoder": f"{widths} x{e.convolutions}",
        "input": INPUTS.get(raster, raster),
        "loss": LOSSES.get(own_loss, own_loss),
        "lr": optimizer.get("lr", 0.0),
        "queries": cfg.episode.queries,
        "seed": cfg.seed,
        "shots": cfg.episode.shots,
        "similarity": cfg.similarity.kind,
        "ways": cfg.episode.ways,
    }
    groups = ("representation", "encoder", "similarity", "loss", "episode", "optimizer")
    rest = flattened({name: build.plain(getattr(cfg, name)) for name in groups})
    return short | {
        f"more.{key}": value if isinstance(value, Value) else str(value)
        for key, value in rest.items()
    }
