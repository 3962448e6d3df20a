"""Aligned candidates as rows of their own beside a method's."""

import pytest

from deepring.errors import DeepringError
from deepring.evaluation.results import read_results
from deepring.experiment.train import train


@pytest.fixture
def ring(composed, tiny_nclt):
    def make(*overrides):
        return composed(
            *("method=ring", "data=sim_nclt", f"data.root={tiny_nclt}", "data.spacing.train=1"),
            *("evaluation.regions=[whole]", "evaluation.figures=false", "callbacks.progress=null"),
            *("methods.scan_context=null", "methods.scan_context_120=null"),
            *("data.query_turn_seed=1", *overrides),
        )

    return make


def test_each_mode_is_a_row_that_says_what_it_is(ring, tmp_path):
    train(ring("evaluation.rerank=[pose,locate]", "evaluation.candidates=5"), tmp_path / "run")
    rows = [r for r in read_results(tmp_path / "run" / "results.csv") if r.radius_m == 10]
    by_name = {row.case.method: row for row in rows}
    assert list(by_name) == [
        "RING",
        "RING + pose re-ranking",
        "RING + map poses (localisation)",
    ]
    alone, posed, located = rows
    assert located.recall_1 == 1.0
    assert located.recall_1 >= alone.recall_1
    assert posed.recall_1 >= alone.recall_1
    assert len({row.answerable for row in rows}) == 1
    assert posed.seconds_per_query > alone.seconds_per_query
    assert len(list((tmp_path / "run" / "retrievals").glob("*.csv"))) == 3


def test_pose_re_ranking_is_a_row_by_default_and_can_be_left_out(ring):
    assert ring().evaluation.rerank == ["pose"]
    assert ring("evaluation.rerank=[]").evaluation.rerank == []


def test_modes_that_are_none_are_refused(ring):
    with pytest.raises(DeepringError, match=r"evaluation\.rerank: 'poses'"):
        ring("evaluation.rerank=[poses]")
    with pytest.raises(DeepringError, match=r"evaluation\.candidates: 0"):
        ring("evaluation.candidates=0")
