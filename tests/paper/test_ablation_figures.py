"""What stands in the figures of an ablation."""

import pytest

from deepring.evaluation.case import Case
from deepring.paper.ablation import ablation_tables
from deepring.paper.ablation_figures import ablation_figure
from deepring.paper.seed_groups import Run
from deepring.reports.style import save
from helpers.results import result_of


def run(recall, seed=0, kind="dft", ways=24, pool=1):
    rates = (recall, 0.9, 0.8, 0.7)
    result = result_of(Case("DeepRING", "sim", "sim", "test"), 10.0, rates=rates)
    config = {
        "seed": seed,
        "method": {
            "_target_": "deepring.methods.deepring.DeepRing",
            "raster": {"kind": "bev"},
            "representation": {"pool": pool, "theta_range": "full"},
            "aggregation": {"kind": kind},
            "similarity": {"kind": "correlation"},
        },
        "loss": {"_target_": "losses.OneShotCrossEntropy"},
        "sampling": {"ways": ways},
    }
    return Run(f"{kind}{ways}-{pool}-{seed}", config, [result])


def drawn(runs):
    (table,) = ablation_tables(runs)
    figure = ablation_figure(table)
    return figure, figure.axes[0]


def marks(axes, label):
    """Points of all plotted lines of this label."""
    lines = [line for line in axes.lines if line.get_label() == label]
    return [tuple(point) for line in lines for point in line.get_xydata()]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_each_row_has_its_mean_its_seeds_and_the_papers_value(tmp_path):
    runs = [run(0.5), run(0.7, 1), run(0.2, kind="gap"), run(0.9, kind="other")]
    figure, axes = drawn(runs)
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["SG / GAP / CE", "SG / other / CE", "SG / DFT / CE"]
    assert [bar.get_width() for bar in axes.patches] == pytest.approx([0.2, 0.9, 0.6])
    assert [x for x, _ in marks(axes, "one seed")] == [0.2, 0.9, 0.5, 0.7]
    ticks = axes.get_yticks()
    assert marks(axes, "paper (NCLT)") == [(0.639, ticks[0]), (0.859, ticks[2])]
    assert legend(figure) == ["mean ± sample sd", "one seed", "paper (NCLT)"]
    save(figure, tmp_path / "rows.png", dpi=40)


def test_the_error_bar_is_the_sample_deviation():
    _, axes = drawn([run(0.5), run(0.7, 1)])
    ((segment,),) = (container.get_segments() for container in axes.collections)
    assert [x for x, _ in segment] == pytest.approx([0.6 - 0.1414214, 0.6 + 0.1414214])


def test_no_value_of_the_paper_no_diamond():
    figure, axes = drawn([run(0.5, kind="other")])
    assert not marks(axes, "paper (NCLT)")
    assert legend(figure) == ["mean ± sample sd", "one seed"]


def test_ways_lie_along_the_axis_with_the_papers_values(tmp_path):
    figure, axes = drawn([run(0.84, 0, ways=8), run(0.86, 1, ways=8), run(0.87, ways=32)])
    assert list(axes.get_xticks()) == [8, 32]
    assert marks(axes, "paper (NCLT)") == [(8, 0.834), (32, 0.855)]
    assert [y for _, y in marks(axes, "one seed")] == [0.84, 0.86, 0.87]
    low, high = axes.get_ylim()
    assert low < 0.834 < 0.87 < high
    assert high - low >= 0.1, "little noise is not blown up"
    save(figure, tmp_path / "ways.png", dpi=40)


def test_ways_have_a_line_for_each_further_setting():
    figure, axes = drawn([run(0.8, ways=w, pool=p) for w in (8, 16) for p in (1, 2)])
    assert legend(figure)[:2] == ["pool 1: mean ± sample sd", "pool 2: mean ± sample sd"]
    assert marks(axes, "paper (NCLT)") == [(8, 0.834), (16, 0.855)], "once, though of two lines"
