"""The rows of the paper's Tables I to IV, their names, and the values that it measured."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from deepring.evaluation.reranked_labels import method_label
from deepring.paper.seed_groups import SeedGroup, varied
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
    """The components that Table III compares, by the paper's names."""

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


def components(row: SeedGroup) -> Components:
    """A row's components; one without a name of the paper's has its config's."""
    raster = str(row.setting.get("method.raster.kind", NONE))
    kind = str(row.setting.get("method.aggregation.kind", NONE))
    loss = str(row.setting.get("loss._target_", NONE)).rpartition(".")[2]
    return Components(
        INPUTS.get(raster, raster), AGGREGATIONS.get(kind, kind), LOSSES.get(loss, loss)
    )


def paper_recall(row: SeedGroup, rows: Sequence[SeedGroup]) -> float | None:
    """Table III's Recall@1 of a row; None where the row is no setting of the paper's.

    Its similarity and its ways must be the paper's. So must be whatever varies between it and
    ``rows`` with its components; a key that the paper says nothing of leaves open which of them
    is the paper's.
    """
    value = PAPER.get(components(row))
    return value if value is not None and _as_in_paper(row, rows, STATED) else None


def paper_recall_at_ways(row: SeedGroup, rows: Sequence[SeedGroup]) -> float | None:
    """Table IV's Recall@1 of a row of SG/DFT/CE; None as in `paper_recall`, at any ways."""
    ways = row.setting.get(WAYS, 0)
    return PAPER_WAYS.get(ways) if _as_in_paper(row, rows, {**STATED, WAYS: ways}) else None


def _as_in_paper(row: SeedGroup, rows: Sequence[SeedGroup], stated: Mapping[str, Any]) -> bool:
    own = components(row)
    alike = [other for other in rows if components(other) == own]
    stated = {**stated, SIMILARITY: "correlation" if own.loss == OURS.loss else "l2"}
    return all(
        key in stated and row.setting.get(key) == stated[key] for key in {*_ALWAYS, *varied(alike)}
    )


class Rates(NamedTuple):
    """A row of the paper's."""

    recall_1: float
    f1_max: float
    auc: float


#: The paper's Table I (test trajectory) and Table II (whole trajectory, trained on the other
#: dataset), by dataset family and the paper's name of the method.
PAPER_RATES: dict[tuple[str, str, str], Rates] = {
    ("table1", "NCLT", "Scan Context"): Rates(0.469, 0.638, 0.570),
    ("table1", "NCLT", "RING"): Rates(0.664, 0.798, 0.839),
    ("table1", "NCLT", "PointNetVLAD"): Rates(0.508, 0.539, 0.627),
    ("table1", "NCLT", "DiSCO"): Rates(0.793, 0.887, 0.849),
    ("table1", "NCLT", "EgoNN"): Rates(0.763, 0.866, 0.842),
    ("table1", "NCLT", "DeepRING"): Rates(0.859, 0.894, 0.893),
    ("table1", "MulRan", "Scan Context"): Rates(0.584, 0.737, 0.698),
    ("table1", "MulRan", "RING"): Rates(0.713, 0.833, 0.843),
    ("table1", "MulRan", "PointNetVLAD"): Rates(0.697, 0.821, 0.842),
    ("table1", "MulRan", "DiSCO"): Rates(0.743, 0.863, 0.897),
    ("table1", "MulRan", "EgoNN"): Rates(0.726, 0.841, 0.906),
    ("table1", "MulRan", "DeepRING"): Rates(0.893, 0.943, 0.943),
    ("table2", "NCLT", "Scan Context"): Rates(0.507, 0.673, 0.629),
    ("table2", "NCLT", "RING"): Rates(0.708, 0.829, 0.847),
    ("table2", "NCLT", "PointNetVLAD"): Rates(0.369, 0.539, 0.626),
    ("table2", "NCLT", "DiSCO"): Rates(0.604, 0.779, 0.773),
    ("table2", "NCLT", "EgoNN"): Rates(0.562, 0.696, 0.799),
    ("table2", "NCLT", "DeepRING"): Rates(0.797, 0.887, 0.881),
    ("table2", "MulRan", "Scan Context"): Rates(0.524, 0.688, 0.653),
    ("table2", "MulRan", "RING"): Rates(0.764, 0.866, 0.883),
    ("table2", "MulRan", "PointNetVLAD"): Rates(0.561, 0.719, 0.722),
    ("table2", "MulRan", "DiSCO"): Rates(0.745, 0.854, 0.796),
    ("table2", "MulRan", "EgoNN"): Rates(0.663, 0.797, 0.850),
    ("table2", "MulRan", "DeepRING"): Rates(0.826, 0.904, 0.901),
}

FAMILIES = ("NCLT", "MulRan")

#: Our labels in the paper's order, and the paper's name; it has no value of the original form of
#: Scan Context, only of one with everybody's resolution.
_METHODS: dict[str, str | None] = {
    "Scan Context 20x60": None,
    "Scan Context 120x120": "Scan Context",
    "RING": "RING",
    "PointNetVLAD": "PointNetVLAD",
    "DiSCO": "DiSCO",
    "EgoNN": "EgoNN",
    "DeepRING": "DeepRING",
}

#: Half of the last digit of both Recall@1 and F1, and a little: what rounding may hide.
_ROUNDING = 1.1e-3


def family(dataset: str) -> str | None:
    """'NCLT' or 'MulRan' where the dataset's name holds one of them, in any case; else None."""
    names = [name for name in FAMILIES if name.lower() in dataset.lower()]
    return names[0] if len(names) == 1 else None


def paper_rates(table: str, dataset: str, label: str) -> Rates | None:
    """The paper's values for a method on a dataset's family; None where it has none.

    Words may follow the name in ``label``, as in "DiSCO small"; "RING++" is not RING. The paper
    re-ranks nothing.
    """
    if method_label(label) != label:
        return None
    known, name = family(dataset), _METHODS.get(_base(label) or "")
    if known is None or name is None:
        return None
    return PAPER_RATES.get((table, known, name))


def place_of(label: str) -> tuple[int, str]:
    """Sort key: methods in the paper's order, then those that it does not name."""
    base = _base(label)
    return (len(_METHODS) if base is None else list(_METHODS).index(base)), label


def slip(rates: Rates) -> float | None:
    """2R / (1 + R) where the F1 of a row of the paper's lies below that; else None.

    Accepting every query gives this F1 where all of them are answerable, so that the maximum over
    thresholds cannot lie below it.
    """
    bound = 2 * rates.recall_1 / (1 + rates.recall_1)
    return bound if rates.f1_max < bound - _ROUNDING else None


def _base(label: str) -> str | None:
    """The paper's method that a label begins with, as a whole word."""
    return next((base for base in _METHODS if f"{label} ".startswith(f"{base} ")), None)
