"""Ablation tables: what is one row, what may stand beside what, and what is the paper's."""

import statistics
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.paper.ablation import ablation_tables
from deepring.paper.ablation_results import by_place, collect_rows
from deepring.paper.ablation_tables import number_table, shown_table
from deepring.paper.comparison import is_comparison
from deepring.paper.seed_groups import ABOUT_INTERVALS, Run, varied
from deepring.paper.seed_words import mean_text
from helpers.results import result_of, without_intervals

LOSSES = "deepring.training.episodes."
GAP = {"method.aggregation.kind": "gap"}
PG = {"method.raster.kind": "polar", "method.representation.angles": None}
TRIPLET = {
    "loss": {"_target_": f"{LOSSES}Triplet", "margin": 0.5},
    "method.similarity.kind": "l2",
}


def config(seed=0, changes=()):
    whole = {
        "seed": seed,
        "experiment_name": "demo",
        "data": {"name": "sim", "root": f"worlds/{seed}", "database": "a", "regions": {"test": []}},
        "train_data": {},
        "preprocessing": {"window": 5},
        "evaluation": {"regions": ["test"], "radii": [10.0, 5.0], "over": "answerable"},
        "method": {
            "_target_": "deepring.methods.deepring.DeepRing",
            "raster": {"kind": "bev", "preprocessing": {"window": 5}},
            "representation": {"angles": 120, "pool": 2, "theta_range": "full"},
            "encoder": {"widths": [8, 16]},
            "aggregation": {"kind": "dft"},
            "similarity": {"kind": "correlation", "normalisation": "unit"},
        },
        "loss": {"_target_": f"{LOSSES}OneShotCrossEntropy", "temperature_scale": 100.0},
        "sampling": {"ways": 24, "shots": 1},
        "optimizer": {"lr": 1e-3},
        "trainer": {"accelerator": "cpu", "max_epochs": 12},
        "workers": 0,
        "paths": {"run": f"runs/{seed}"},
    }
    for key, value in dict(changes).items():
        node = whole
        *path, last = key.split(".")
        for part in path:
            node = node[part]
        node[last] = value
    return whole


def run(recall=0.5, seed=0, changes=(), folder=None, **fields):
    rates = (recall, 0.9, 0.8, 0.7)
    row = result_of(Case("DeepRING", "sim", "sim", "test"), 10.0, rates=rates)
    results = [
        replace(row, **fields),
        replace(row, radius_m=5.0, wrong_beyond_m=5.0, recall_1=0.25),
    ]
    baseline = replace(row, case=Case("RING", "", "sim", "test"), recall_1=0.0)
    changes = dict(changes)
    folder = folder or f"{'+'.join(f'{k}-{v}' for k, v in changes.items()) or 'ours'}+seed-{seed}"
    return Run(folder, config(seed, changes), [baseline, *results], ["c0ffee"])


def table(runs, **kwargs):
    (only,) = ablation_tables(runs, **kwargs)
    return only


def texts(grid):
    """Rows of a grid as lists of text, without intervals; bold in stars."""
    rows = [[(without_intervals(text), bold) for text, bold in row] for row in grid.rows]
    return [[f"*{text}*" if bold else text for text, bold in row] for row in rows]


def column(grid, header):
    cells = [row[list(grid.headers).index(header)] for row in grid.rows]
    return [without_intervals(cell.text) for cell in cells]


def test_a_row_is_the_mean_and_sample_deviation_over_its_seeds():
    runs = [run(recall, seed) for seed, recall in enumerate([0.5, 0.6, 0.8])]
    (entry,) = table(runs).entries
    assert entry.recalls == {0: 0.5, 1: 0.6, 2: 0.8}
    assert entry.mean == pytest.approx(0.6333333)
    assert entry.deviation == pytest.approx(0.1527525), "n - 1, not n"
    assert entry.deviation != pytest.approx(statistics.pstdev([0.5, 0.6, 0.8]))
    assert mean_text(entry.recalls.values()) == "0.633 ± 0.153"


def test_one_run_has_no_deviation():
    (entry,) = table([run(0.5)]).entries
    assert (mean_text(entry.recalls.values()), entry.deviation) == ("0.500", None)
    assert "one run a row, seed 0" in table([run(0.5)]).notes


@given(st.permutations(range(3)), st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_the_order_of_runs_does_not_matter(order, recalls):
    runs = [run(recall, seed) for seed, recall in enumerate(recalls)]
    runs += [run(1 - recall, seed, GAP) for seed, recall in enumerate(recalls)]
    shuffled = [runs[k + 3 * half] for half in (1, 0) for k in order]
    assert texts(number_table(table(shuffled))) == texts(number_table(table(runs)))


@pytest.mark.parametrize(
    "changes",
    [
        {"workers": 4},
        {"paths.run": "elsewhere"},
        {"experiment_name": "other"},
        {"trainer.accelerator": "gpu"},
        {"data.root": "worlds/other"},
        {"evaluation.radii": [10, 15]},
        {"optimizer.lr": 0.001},
        {"evaluation.descriptors": True},
        {"overlap": "leave_out"},
        {"method.note": "small"},
    ],
)
def test_what_cannot_change_what_is_learnt_makes_no_other_row(changes):
    assert len(collect_rows([run(), run(seed=1, changes=changes)])[0]) == 1


def test_where_further_test_data_lie_may_go_with_the_seed():
    runs = [run(seed=s, changes={"test_data": {"x": {"root": f"x{s}"}}}) for s in (0, 1)]
    assert len(collect_rows(runs)[0]) == 1
    other = run(folder="two", changes=GAP | {"test_data": {"x": {"root": "elsewhere"}}})
    with pytest.raises(DeepringError, match=r"test_data\.x\.root \(seed 0\): 'x0' in"):
        collect_rows([*runs, other])


@pytest.mark.parametrize(
    "changes",
    [{"optimizer.lr": 0.01}, {"method.encoder.widths": [8, 32]}, {"trainer.max_epochs": 13}, GAP],
)
def test_anything_else_does(changes):
    assert len(collect_rows([run(), run(seed=1, changes=changes)])[0]) == 2


def test_the_methods_preprocessing_is_no_key_of_its_own_unless_it_is_set_apart():
    both = {"preprocessing.window": 7, "method.raster.preprocessing.window": 7}
    rows = collect_rows([run(), run(seed=1, changes=both)], mix=True)[0]
    assert varied(rows) == ["preprocessing.window"]
    apart = {"method.raster.preprocessing.window": 7}
    rows = collect_rows([run(), run(seed=1, changes=apart)])[0]
    assert varied(rows) == ["method.raster.preprocessing.window"]


def test_means_over_other_seeds_are_not_called_best():
    both = [run(0.5), run(0.9, seed=1), run(0.6, changes=GAP), run(0.7, seed=1, changes=GAP)]
    assert any(cell.bold for row in shown_table(table(both)).rows for cell in row)
    assert not any(cell.bold for row in shown_table(table(both[:3])).rows for cell in row)


def test_the_same_row_and_seed_twice_is_refused_naming_both_unless_they_agree():
    with pytest.raises(
        DeepringError, match=r"seed 0: twice, .* 0\.5 in first, 0\.6 in second; .* delete"
    ):
        collect_rows([run(0.5, folder="first"), run(0.6, folder="second")])
    (row,) = collect_rows([run(folder="first"), run(folder="second")])[0]
    assert list(row.results) == [0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"data.database": "b"}, r"data\.database: 'a' in one, 'b' in two"),
        ({"data.regions": {"test": [1]}}, r"data\.regions\.test: \[\] in one, \[1\] in two"),
        ({"data.root": "elsewhere"}, r"data\.root \(seed 0\): 'worlds/0' in one, 'elsewhere'"),
        ({"preprocessing.window": 7}, r"preprocessing\.window: 5 in one, 7 in two"),
        ({"train_data": {"x": {"name": "x"}}}, r"train_data\.x\.name: None in one, 'x' in two"),
        ({"evaluation.over": "all"}, r"evaluation\.over: 'answerable' in one"),
        ({"evaluation.radii": [5.0, 10.0]}, r"evaluation\.radii\[0\]: 10 in one, 5 in two"),
    ],
)
def test_other_data_or_protocol_is_refused_naming_key_values_and_folders(changes, message):
    runs = [run(folder="one"), run(changes=GAP | changes, folder="two")]
    with pytest.raises(DeepringError, match=rf"^{message}.*`mix`"):
        collect_rows(runs)


def test_results_counted_on_other_queries_are_refused_within_a_seed_alone():
    runs = [run(folder="one"), run(changes=GAP, folder="two", queries=99)]
    message = r"results queries \(seed 0\): 100 in one, 99 in two"
    with pytest.raises(DeepringError, match=message):
        collect_rows(runs)
    collect_rows([run(), run(changes=GAP), run(seed=1, queries=99)])
    assert any("99 in two" in note for note in collect_rows(runs, mix=True)[1])


def test_mixed_what_differs_is_a_column_even_where_the_components_tell_it_apart():
    runs = [run(0.5), run(0.6, changes=GAP | {"data.name": "real"})]
    grid = shown_table(table(runs, mix=True))
    assert column(grid, "data.name") == ["real", "sim"]
    assert any("mixed" in note for note in grid.notes)


def test_mixed_places_within_a_seed_are_rows_of_their_own():
    grid = shown_table(table([run(), run(changes={"data.root": "elsewhere"})], mix=True))
    assert column(grid, "data.root") == ["elsewhere", "worlds/0"]
    worlds = [run(seed=seed, changes=changes) for seed in (0, 1) for changes in ({}, GAP)]
    assert "data.root" not in shown_table(table(worlds, mix=True)).headers


def test_table_three_is_laid_out_as_the_paper_prints_it():
    two_dft = TRIPLET | {"method.aggregation.kind": "dft2"}
    kinds = [{}, TRIPLET, PG, GAP, {"method.aggregation.kind": "gmp"}, two_dft]
    kinds.append({"method.aggregation.kind": "multi_gap"})
    shown = table([run(0.1 * (k + 1), changes=kind) for k, kind in enumerate(kinds)])
    assert shown.name == "table3"
    grid = shown_table(shown)
    assert grid.headers == ["Ablation", "Input", "Aggregation", "Loss", "Recall@1", "paper"]
    assert texts(grid) == [
        ["Representation", "PG", "DFT", "CE", "0.300", "0.834"],
        ["Aggregation", "SG", "GMP", "CE", "0.500", "0.534"],
        ["", "SG", "GAP", "CE", "0.400", "0.639"],
        ["", "SG", "Multi-GAP", "CE", "*0.700*", "0.743"],
        ["Loss", "SG", "DFT", "Triplet", "0.200", "0.644"],
        ["", "SG", "2DFT", "Triplet", "0.600", "0.747"],
        ["Ours", "SG", "DFT", "CE", "0.100", "0.859"],
    ]
    assert list(grid.breaks) == [1, 4, 6]


def test_a_key_that_follows_from_the_components_is_no_column_and_one_that_does_not_is():
    plain = [run(), run(changes=TRIPLET)]
    assert "method.similarity.kind" not in shown_table(table(plain)).headers
    grid = shown_table(
        table([*plain, run(changes=TRIPLET | {"method.similarity.kind": "correlation"})])
    )
    assert column(grid, "method.similarity.kind") == ["correlation", "l2", "correlation"]
    assert column(grid, "paper") == ["-", "0.644", "0.859"], "the paper's triplet goes with L2"


@pytest.mark.parametrize(
    "changes",
    [
        {"method.similarity.kind": "cosine"},
        {"method.representation.theta_range": "half"},
        {"sampling.ways": 8},
    ],
)
def test_another_setting_than_the_papers_has_no_paper_value(changes):
    assert column(shown_table(table([run(changes=changes), run(changes=PG)])), "paper")[1] == "-"


def test_which_row_is_the_papers_is_told_by_what_the_paper_states():
    pools = [run(changes={"method.representation.pool": pool}) for pool in (1, 2)]
    grid = shown_table(table([*pools, run(changes=GAP)]))
    assert column(grid, "paper") == ["0.639", "0.859", "-"]
    widths = [run(changes={"method.encoder.widths": width}) for width in ([8], [16])]
    grid = shown_table(table([*widths, run(changes=GAP)]))
    assert column(grid, "paper") == ["0.639", "-", "-"], "it states no widths"


def ways(*numbers, **changes):
    return [run(number / 100, changes={"sampling.ways": number, **changes}) for number in numbers]


def test_table_four_has_the_ways_as_columns():
    shown = table(ways(24, 8, 64))
    assert shown.name == "table4"
    grid = shown_table(shown)
    assert grid.headers == ["No. Class", "8", "24", "64"]
    assert texts(grid) == [
        ["Recall@1", "0.080", "0.240", "*0.640*"],
        ["paper", "0.834", "0.859", "-"],
    ]


def test_table_four_has_a_line_for_each_further_setting():
    grid = shown_table(table([*ways(8, 16), *ways(8, **{"method.representation.pool": 1})]))
    assert grid.headers == ["No. Class", "method.representation.pool", "8", "16"]
    assert texts(grid)[:2] == [
        ["Recall@1", "1", "0.080", "-"],
        ["Recall@1", "2", "0.080", "*0.160*"],
    ]


def test_both_tables_from_both_sweeps_and_no_row_is_lost():
    first, second = ablation_tables([*ways(8, 16, 24), run(changes=GAP), run(changes=PG)])
    assert (first.name, second.name) == ("table3", "table4")
    assert column(shown_table(first), "Input") == ["PG", "SG", "SG"]
    assert "sampling.ways" not in shown_table(first).headers
    assert len(second.entries) == 3


def test_ways_of_another_network_are_no_table_four():
    grid = shown_table(table([run(changes=PG | {"sampling.ways": number}) for number in (8, 16)]))
    assert (grid.headers[0], column(grid, "sampling.ways")) == ("sampling.ways", ["8", "16"])


def test_any_other_sweep_is_a_table_of_the_keys_it_varies_in_order_of_size():
    runs = [run(rate, changes={"optimizer.lr": rate}) for rate in (0.01, 1e-3, 1e-4)]
    shown = table(runs)
    assert shown.name == "ablation"
    grid = shown_table(shown)
    assert grid.headers == ["optimizer.lr", "Recall@1", "paper"]
    assert texts(grid)[2] == ["0.01", "*0.010*", "-"]
    assert column(grid, "optimizer.lr") == ["0.0001", "0.001", "0.01"]


def test_one_configuration_is_a_table_of_one_row():
    grid = shown_table(table([run(0.5), run(0.7, 1)]))
    assert grid.headers == ["Input", "Aggregation", "Loss", "Recall@1", "paper"]
    assert texts(grid) == [["SG", "DFT", "CE", "0.600 ± 0.141", "0.859"]]


def test_numbers_are_written_in_full():
    runs = [run(1 / 3), run(2 / 3, 1), run(0.1, 1, {"optimizer.lr": 1 / 7})]
    grid = number_table(table(runs))
    rows = [dict(zip(grid.headers, row, strict=True)) for row in texts(grid)]
    assert [row["optimizer.lr"] for row in rows] == ["0.001", repr(1 / 7)]
    assert (rows[0]["n"], rows[0]["seeds"]) == ("2", "0 1")
    assert float(rows[0]["recall_1_std"]) == statistics.stdev([1 / 3, 2 / 3])
    assert (rows[0]["seed_0"], rows[1]["seed_0"]) == (repr(1 / 3), "")
    assert (rows[0]["f1_max_mean"], rows[0]["auc_std"], rows[1]["auc_std"]) == ("0.8", "0.0", "")
    assert (rows[0]["paper"], rows[1]["paper"]) == ("0.859", "")


def test_recall_is_read_at_the_asked_radius_over_the_asked_queries():
    assert table([run(0.5)], radius=5.0).entries[0].mean == 0.25
    assert table([run(0.5)], over="all").entries[0].mean == 0.25
    assert "right within 5 m, recall over all" in table([run()], radius=5.0, over="all").title


def test_a_radius_that_was_not_evaluated_is_named_with_those_that_were():
    with pytest.raises(DeepringError, match=r"radius 7 m: no result of DeepRING in ours.*: 5, 10;"):
        collect_rows([run()], radius=7.0)
    with pytest.raises(DeepringError, match="runs: no result in any"):
        collect_rows([])


def test_notes_say_whose_seeds_are_lacking_and_which_commits_made_the_runs():
    runs = [run(seed=0), run(seed=1), run(seed=1, changes=GAP)]
    other = Run("other", config(0, PG), runs[0].results, [])
    notes = table([*runs, other], notes=["left out: x"]).notes
    lacking = "PG DFT CE has 0; SG GAP CE has 1"
    assert f"rows are not over the same seeds, so that none is marked best: {lacking}" in notes
    assert "made by several versions of the code: commits c0ffee (3 runs), unknown (1 run)" in notes
    assert notes[-1] == "left out: x"
    means = "mean ± sample standard deviation over the seeds 0, 1"
    assert table(runs[:2]).notes == [means, ABOUT_INTERVALS]


def test_a_part_of_the_config_that_rows_have_or_lack_is_one_column():
    polar = {"method.polar": {"rings": 60, "share": 0.2}}
    runs = [run(0.5), run(0.6, changes=polar), run(0.7, changes=polar | {"optimizer.lr": 0.1})]
    grid = shown_table(table(runs))
    assert column(grid, "method.polar") == ["-", "with", "with"]
    other = {"method.polar": {"rings": 30, "share": 0.2}}
    grid = shown_table(table([*runs, run(0.8, changes=other)]))
    assert column(grid, "method.polar.rings") == ["-", "30", "60", "60"]
    assert "method.polar" not in grid.headers


def test_a_sweep_tested_in_several_places_is_a_table_for_each():
    there = Case("DeepRING", "sim", "city", "test")
    runs = [
        replace(one, results=[*one.results, replace(one.results[1], case=there, recall_1=recall)])
        for one, recall in ((run(0.5), 0.2), (run(0.6, changes=GAP), 0.1))
    ]
    assert not is_comparison(runs)
    places = by_place(runs)
    assert list(places) == ["sim test", "city test"]
    recalls = [column(shown_table(table(some)), "Recall@1") for some in places.values()]
    assert recalls == [["0.600", "0.500"], ["0.100", "0.200"]]
