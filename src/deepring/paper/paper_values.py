"""What the paper compares in Tables III and IV, by which names, and what it measured."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from deepring.paper.seed_groups import Row, varied
from deepring.reports.table import NONE

INPUTS = {"polar": "PG", "range": "RI", "bev": "SG"}
AGGREGATIONS = {
    "dft": "DFT",
    "gmp": "GMP",
    "gap": "GAP",
    "multi_gap": "Multi-GAP",
    "dft2": "2DFT",
}
LOSSES = {"OneShotCrossEntropy": "CE", "Triplet": "Triplet", "Quadruplet": "Quadruplet"}


class Components(NamedTuple):
    """What Table III compares, by the paper's names."""

    input: str
    aggregation: str
    loss: str


OURS = Components("SG", "DFT", "CE")

#: Recall@1 on NCLT (paper, Table III and Table IV).
PAPER = {
    Components("PG", "DFT", "CE"): 0.834,
    Components("SG", "GMP", "CE"): 0.534,
    Components("SG", "GAP", "CE"): 0.639,
    Components("SG", "Multi-GAP", "CE"): 0.743,
    Components("SG", "DFT", "Triplet"): 0.644,
    Components("SG", "2DFT", "Triplet"): 0.747,
    OURS: 0.859,
}
PAPER_WAYS = {8: 0.834, 16: 0.855, 24: 0.859, 32: 0.855}

WAYS = "sampling.ways"
SIMILARITY = "method.similarity.kind"

#: Settings that the paper states, beside the similarity that goes with a loss.
STATED = {
    "method.representation.theta_range": "full",
    "method.representation.angles": 120,
    "method.representation.bins": 120,
    "method.representation.pool": 1,
    WAYS: 24,
    "sampling.shots": 1,
    "sampling.queries": 6,
    "sampling.per_epoch": 60,
    "optimizer.lr": 1e-3,
    "optimizer.weight_decay": 1e-4,
    "trainer.max_epochs": 20,
}

#: What a row must share with the paper even where it does not vary: a smaller network or fewer
#: episodes leave the rows what they are, these do not.
_ALWAYS = (SIMILARITY, "method.representation.theta_range", WAYS)


def components(row: Row) -> Components:
    """A row's components; one without a name of the paper's has its config's."""
    raster = str(row.setting.get("method.raster.kind", NONE))
    kind = str(row.setting.get("method.aggregation.kind", NONE))
    loss = str(row.setting.get("loss._target_", NONE)).rpartition(".")[2]
    return Components(
        INPUTS.get(raster, raster), AGGREGATIONS.get(kind, kind), LOSSES.get(loss, loss)
    )


def paper_recall(row: Row, rows: Sequence[Row]) -> float | None:
    """Table III's Recall@1 of a row; None where the row is no setting of the paper's.

    Its similarity and its ways must be the paper's. So must be whatever varies between it and
    ``rows`` with its components; a key that the paper says nothing of leaves open which of them
    is the paper's.
    """
    value = PAPER.get(components(row))
    return value if value is not None and _as_in_paper(row, rows, STATED) else None


def paper_recall_at_ways(row: Row, rows: Sequence[Row]) -> float | None:
    """Table IV's Recall@1 of a row of SG/DFT/CE; None as in `paper_recall`, at any ways."""
    ways = row.setting.get(WAYS, 0)
    return PAPER_WAYS.get(ways) if _as_in_paper(row, rows, {**STATED, WAYS: ways}) else None


def _as_in_paper(row: Row, rows: Sequence[Row], stated: Mapping[str, Any]) -> bool:
    own = components(row)
    alike = [other for other in rows if components(other) == own]
    stated = {**stated, SIMILARITY: "correlation" if own.loss == OURS.loss else "l2"}
    return all(
        key in stated and row.setting.get(key) == stated[key] for key in {*_ALWAYS, *varied(alike)}
    )
