"""Tables I and II: which results stand where, what is a mean, what is refused, what is noted."""

import re
import statistics
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.paper.comparison import compare, is_comparison
from deepring.paper.comparison_tables import number_table, shown_tables
from deepring.paper.paper_values import PAPER_RATES, Rates, family, paper_rates, slip
from deepring.paper.seed_groups import ABOUT_INTERVALS, Run
from deepring.reports.table import latex, markdown
from helpers.results import result_of, without_intervals

NCLT, MULRAN, KITTI = "sim_nclt", "sim_mulran", "sim_kitti"
CLASSES = {"DiSCO": "disco.Disco", "EgoNN": "egonn.EgoNnGlobal", "RING": "ring.Ring"}


def result(method, train, test, region="test", recall=0.5, **fields):
    rates = (recall, 0.9, 0.8, 0.7)
    counts = (50, 100, 80)
    return replace(result_of(Case(method, train, test, region), 10.0, counts, rates), **fields)


def dataset(name, seed, **changes):
    node = {"name": name, "format": "nclt", "root": f"worlds/{name}_{seed}"}
    return {**node, "spacing": {"database": 20, "query": 5}, "regions": {"test": []}, **changes}


def run(method, train, results, seed=0, folder=None, seconds=None, method_config=(), **changes):
    """A run of ``method``, trained on ``train`` ("" for none), with these results."""
    config = {
        "seed": seed,
        "data": dataset(train or NCLT, seed),
        "test_data": {name: dataset(name, seed) for name in (NCLT, MULRAN)},
        "preprocessing": {"window": 5},
        "evaluation": {"radii": [10.0, 5.0], "over": "answerable", "regions": ["test"]},
        "method": {
            "_target_": f"deepring.methods.{CLASSES.get(method, 'deepring.DeepRing')}",
            **({} if train else {"label": method}),
            **dict(method_config),
        },
        "optimizer": {"lr": 1e-3},
        "paths": {"run": f"runs/{seed}"},
    } | changes
    folder = folder or f"{method}-{train or 'none'}-{seed}"
    return Run(folder, config, results, ["c0ffee"], seconds)


def learned(method="DiSCO", train=NCLT, seed=0, home=0.8, away=0.6, **kwargs):
    """A run tested in the test region at home, and on test and whole of the other dataset."""
    other = MULRAN if train == NCLT else NCLT
    results = [
        result(method, train, train, "test", home),
        result(method, train, other, "test", away),
        result(method, train, other, "whole", away - 0.1, queries=300, answerable=200),
    ]
    return run(method, train, results, seed, **kwargs)


def unlearned(method="RING", seed=0, recall=0.7, **kwargs):
    tests = [(test, region) for test in (NCLT, MULRAN) for region in ("test", "whole")]
    results = [result(method, "", *test, recall) for test in tests]
    results = [
        replace(r, queries=300, answerable=200) if r.case.region == "whole" else r for r in results
    ]
    return run(method, "", results, seed, **kwargs)


def sweep(seeds=(0,), methods=("DeepRING", "DiSCO")):
    """Every method trained on both datasets, and RING, for each seed."""
    runs = []
    for seed in seeds:
        for number, method in enumerate(methods):
            home, away = 0.9 - 0.1 * number - 0.02 * seed, 0.7 - 0.1 * number - 0.04 * seed
            runs += [learned(method, train, seed, home, away) for train in (NCLT, MULRAN)]
        runs.append(unlearned(seed=seed))
    return runs


def shown(runs, **kwargs):
    return shown_tables(compare(runs, **kwargs))


def texts(grid):
    """Rows of a grid as lists of text, without intervals; bold in stars."""
    rows = [[(without_intervals(text), bold) for text, bold in row] for row in grid.rows]
    return [[f"*{text}*" if bold else text for text, bold in row] for row in rows]


def column(grid, header):
    cells = [row[list(grid.headers).index(header)] for row in grid.rows]
    return [without_intervals(cell.text) for cell in cells]


def numbers(runs, **kwargs):
    """Case to header to text."""
    grid = number_table(compare(runs, **kwargs))
    rows = [dict(zip(grid.headers, row, strict=True)) for row in texts(grid)]
    return {(r["method"], r["train"], r["test"], r["region"]): r for r in rows}


# What is compared, and where it stands.


def test_table_one_is_laid_out_as_the_paper_prints_it():
    grid = shown(sweep())["table1"]
    assert grid.headers == [
        *("Dataset", "Approach", "Recall@1", "paper", "F1", "paper", "AUC", "paper")
    ]
    assert texts(grid) == [
        ["sim_nclt", "RING", "0.700", "0.664", "*0.800*", "0.798", "*0.700*", "0.839"],
        ["", "DiSCO", "0.800", "0.793", "*0.800*", "0.887", "*0.700*", "0.849"],
        ["", "DeepRING", "*0.900*", "0.859", "*0.800*", "0.894", "*0.700*", "0.893"],
        ["sim_mulran", "RING", "0.700", "0.713", "*0.800*", "0.833", "*0.700*", "0.843"],
        ["", "DiSCO", "0.800", "0.743", "*0.800*", "0.863", "*0.700*", "0.897"],
        ["", "DeepRING", "*0.900*", "0.893", "*0.800*", "0.943", "*0.700*", "0.943"],
    ]
    assert list(grid.breaks) == [3]
    assert "right within 10 m, recall over answerable queries" in grid.title


def test_table_two_counts_the_whole_of_what_was_not_trained_on():
    grid = shown(sweep())["table2"]
    assert [row[:4] for row in texts(grid)][:3] == [
        ["sim_nclt", "RING", "*0.700*", "0.708"],
        ["", "DiSCO", "0.500", "0.604"],
        ["", "DeepRING", "0.600", "0.797"],
    ]
    assert "trained on" not in grid.headers, "there is only the other one"


def test_a_result_at_home_is_in_no_table_two_and_a_foreign_one_in_no_table_one():
    runs = sweep()
    home = result("DeepRING", NCLT, NCLT, "whole", 0.99, queries=300, answerable=200)
    runs[0] = replace(runs[0], results=[*runs[0].results, home])
    grids = shown(runs)
    assert not any("0.990" in text for row in texts(grids["table2"]) for text in row)
    assert numbers(runs)["DeepRING", NCLT, NCLT, "whole"]["table"] == ""


def test_joint_training_is_no_crossing_and_is_in_the_csv_alone():
    both = f"{NCLT}+{MULRAN}"
    joint = run("EgoNN", both, [result("EgoNN", both, NCLT, r, 0.95) for r in ("test", "whole")])
    joint = replace(joint, results=[joint.results[0]])
    grids = shown([*sweep(), joint])
    assert all("EgoNN" not in column(grids[name], "Approach") for name in ("table1", "table2"))
    assert numbers([*sweep(), joint])["EgoNN", both, NCLT, "test"]["table"] == ""


def test_two_foreign_trainings_of_a_method_are_told_apart():
    kitti = learned(train=KITTI)
    kitti = replace(kitti, results=[r for r in kitti.results if r.case.test != MULRAN])
    grid = shown([*sweep(), kitti])["table2"]
    block = [row for row in texts(grid)[: min(grid.breaks)] if row[1] == "DiSCO"]
    assert {row[2] for row in block} == {KITTI, MULRAN}


def test_what_nobody_trained_on_is_a_further_test_set():
    extra = [result("DiSCO", NCLT, KITTI, region, 0.4) for region in ("test", "whole")]
    runs = sweep(methods=("DiSCO",))
    runs[0] = replace(runs[0], results=[*runs[0].results, *extra])
    ring = unlearned()
    runs[-1] = replace(ring, results=[*ring.results, result("RING", "", KITTI, "test", 0.3)])
    grids = shown(runs)
    assert texts(grids["further"]) == [
        ["sim_kitti test", "RING", "-", "0.300", "*0.800*", "*0.700*"],
        ["", "DiSCO", "sim_nclt", "*0.400*", "*0.800*", "*0.700*"],
        ["sim_kitti whole", "DiSCO", "sim_nclt", "0.400", "0.800", "0.700"],
    ]
    assert KITTI not in column(grids["table1"], "Dataset") + column(grids["table2"], "Dataset")


def test_methods_that_learn_nothing_alone_are_further_test_sets():
    grids = shown([unlearned()])
    assert set(grids) == {"further", "costs"}


def test_methods_stand_in_the_papers_order_and_others_behind():
    labels = ["DeepRING", "M2DP", "Scan Context 120x120", "RING", "Scan Context 20x60", "RING++"]
    runs = [learned("EgoNN"), *(unlearned(label) for label in labels)]
    grid = shown(runs)["table1"]
    expected = ["Scan Context 20x60", "Scan Context 120x120", "RING", "EgoNN", "DeepRING"]
    assert column(grid, "Approach") == [*expected, "M2DP", "RING++"]
    paper = [row[3] for row in texts(grid)]
    assert paper == ["-", "0.469", "0.664", "0.763", "0.859", "-", "-"]


@settings(max_examples=25, deadline=None)
@given(st.permutations(sweep(seeds=(0, 1))))
def test_the_order_of_runs_does_not_matter(runs):
    ordered, grids = shown(sweep(seeds=(0, 1))), shown(runs)
    assert {name: texts(grid) for name, grid in grids.items()} == {
        name: texts(grid) for name, grid in ordered.items()
    }


# Means, deviations, what is best.


def test_a_value_is_the_mean_and_sample_deviation_over_its_seeds():
    recalls = [0.5, 0.6, 0.8]
    runs = [learned(seed=seed, home=recall) for seed, recall in enumerate(recalls)]
    assert column(shown(runs)["table1"], "Recall@1") == ["0.633 ± 0.153"]
    row = numbers(runs)["DiSCO", NCLT, NCLT, "test"]
    assert float(row["recall_1_mean"]) == pytest.approx(0.6333333)
    assert float(row["recall_1_std"]) == statistics.stdev(recalls) != statistics.pstdev(recalls)
    assert (row["n"], row["seeds"]) == ("3", "0 1 2")
    assert (row["radius_m"], row["over"], row["table"]) == ("10.0", "answerable", "table1")
    assert [row[f"recall_1_seed_{seed}"] for seed in range(3)] == ["0.5", "0.6", "0.8"]
    assert [row[f"paper_{metric}"] for metric in Rates._fields] == ["0.793", "0.887", "0.849"]
    assert float(row["f1_max_mean"]) == pytest.approx(0.8)
    assert row["auc_std"] == "0.0"


def test_numbers_are_written_in_full_and_what_is_not_there_is_empty():
    row = numbers([learned(home=1 / 3)])["DiSCO", NCLT, NCLT, "test"]
    assert (row["recall_1_mean"], row["recall_1_std"]) == (repr(1 / 3), "")
    row = numbers([learned(), learned(train=MULRAN, seed=1)])["DiSCO", NCLT, MULRAN, "whole"]
    assert (row["recall_1_seed_1"], row["paper_auc"]) == ("", "0.796")


def test_other_radius_and_all_queries():
    at_five = [replace(r, radius_m=5.0, recall_1=0.2) for r in learned().results]
    runs = [replace(learned(), results=[*learned().results, *at_five])]
    assert column(shown(runs, radius=5.0)["table1"], "Recall@1") == ["0.200"]
    grid = shown(runs, over="all")["table1"]
    assert column(grid, "Recall@1") == ["0.640"], "0.8 of the 80 that are answerable, of 100"
    assert "right within 10 m, recall over all queries" in grid.title
    with pytest.raises(DeepringError, match="over: 'some'"):
        compare(runs, over="some")


def test_none_is_best_in_a_block_whose_rows_have_other_seeds():
    runs = [*sweep(seeds=(0, 1)), learned("EgoNN", seed=1)]
    grid = shown(runs)["table1"]
    bold = [any(cell.bold for cell in row) for row in grid.rows]
    assert bold == [False] * 4 + [True] * 3
    assert (
        "sim_nclt test: rows are not over the same seeds, so that none is marked best: "
        "EgoNN has 1" in grid.notes
    )
    assert not any("not over the same" in note for note in shown(sweep())["table1"].notes)


def test_blocks_over_other_seeds_say_which():
    runs = [learned(seed=0), learned(seed=1), learned(train=MULRAN, seed=0)]
    notes = shown(runs)["table1"].notes
    assert "sim_nclt test: mean ± sample standard deviation over the seeds 0, 1" in notes
    assert "sim_mulran test: one run a row, seed 0" in notes


# What crossing costs, and what methods take.


def test_crossing_is_counted_on_the_same_queries_seed_by_seed():
    runs = [learned(seed=s, home=0.8 - 0.1 * s) for s in (0, 1)]
    runs += [learned(train=MULRAN, seed=s, away=0.6 + 0.1 * s) for s in (0, 1)]
    grid = shown(runs)["crossing"]
    assert grid.headers == [
        *("Dataset", "Approach", "trained elsewhere on", "in-domain", "crossed", "difference")
    ]
    assert texts(grid)[0] == [
        *(NCLT, "DiSCO", MULRAN, "0.750 ± 0.071", "0.650 ± 0.071", "-0.100 ± 0.141")
    ]
    assert column(grid, "Dataset") == [NCLT, MULRAN]
    assert "RING" not in column(grid, "Approach")


def test_crossing_needs_both_of_one_seed():
    assert "crossing" not in shown([learned(seed=0), learned(train=MULRAN, seed=1)])
    runs = [learned(seed=0), learned(seed=1, home=0.2), learned(train=MULRAN, seed=0)]
    grid = shown([*runs, learned("EgoNN"), learned("EgoNN", MULRAN)])["crossing"]
    first = texts(grid)[0]
    assert first[3:] == ["*0.800*", "*0.600*", "*-0.200*"], "seed 1 has no other half"
    assert grid.notes == ["one run a row, seed 0", ABOUT_INTERVALS]


def test_costs_are_medians_over_results_and_a_mean_over_trainings():
    runs = [learned(seed=0, seconds=60.0), learned(seed=1, seconds=180.0), unlearned()]
    slow = replace(runs[0].results[0], seconds_per_scan=9.0)
    runs[0] = replace(runs[0], results=[slow, *runs[0].results[1:]])
    grid = shown(runs)["costs"]
    assert grid.headers == ["Approach", "ms/scan", "ms/query", "training (min)", "seeds"]
    assert texts(grid) == [["RING", "10", "2", "-", "1"], ["DiSCO", "10", "2", "2", "2"]]


# What is refused.


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"preprocessing": {"window": 7}}, r"preprocessing\.window: 5 in one, 7 in two"),
        (
            {"evaluation": {"radii": [5.0, 10.0], "over": "answerable"}},
            r"evaluation\.radii\[0\]: 10 in one, 5 in two",
        ),
        (
            {"evaluation": {"radii": [10.0], "over": "all"}},
            r"evaluation\.over: 'answerable' in one, 'all' in two",
        ),
        (
            {"test_data": {"x": dataset(NCLT, 0, spacing={"database": 10, "query": 5})}},
            r"data sim_nclt spacing\.database: 20 in one, 10 in two",
        ),
        (
            {"test_data": {"x": dataset(MULRAN, 0, regions={"test": [1]})}},
            r"data sim_mulran regions\.test: \[\] in one, \[1\] in two",
        ),
        (
            {"data": dataset(MULRAN, 0, root="elsewhere")},
            r"data sim_mulran root \(seed 0\): 'worlds/sim_mulran_0' in one, 'elsewhere' in two",
        ),
    ],
)
def test_other_data_or_protocol_is_refused_naming_key_values_and_folders(changes, message):
    runs = [learned(folder="one"), learned("EgoNN", MULRAN, folder="two", **changes)]
    with pytest.raises(DeepringError, match=rf"^{message}; expected runs on the same .*`mix`"):
        compare(runs)
    notes = shown(runs, mix=True)["table1"].notes
    assert any(re.match(rf"mixed, .* not be comparable: {message}", note) for note in notes)


def test_what_is_trained_on_is_not_held_against_what_is_tested_on():
    narrow = {"spacing": {"database": 20, "query": 5, "train": 1}, "regions": {"test": []}}
    runs = [learned(data=dataset(NCLT, 0, **narrow)), learned(train=MULRAN)]
    compare(runs)
    other = learned("EgoNN", data=dataset(NCLT, 0))
    with pytest.raises(DeepringError, match=r"data sim_nclt spacing\.train: 1 in .*, None in"):
        compare([*runs, other])


def test_data_may_lie_elsewhere_for_another_seed_and_test_sets_may_be_more():
    runs = [learned(seed=0), learned(seed=1), learned("EgoNN", test_data={})]
    compare(runs)


def test_results_counted_on_other_queries_are_refused_within_a_seed_alone():
    runs = [learned(folder="one"), unlearned(folder="two")]
    odd = [replace(r, database=49) if r.case.test == NCLT else r for r in runs[1].results]
    runs[1] = replace(runs[1], results=odd)
    message = r"results database on sim_nclt test \(seed 0\): 50 in one, 49 in two; expected"
    with pytest.raises(DeepringError, match=message):
        compare(runs)
    compare([learned(seed=1), runs[1]])
    fewer = [replace(r, answerable=79) for r in learned("EgoNN").results[:1]]
    runs = [learned(folder="one"), run("EgoNN", NCLT, fewer, folder="two")]
    with pytest.raises(DeepringError, match=r"results answerable .*: 80 in one, 79 in two"):
        compare(runs)
    notes = shown(runs, mix=True)["table1"].notes
    assert "sim_nclt test: queries answerable: 80 of 100 or 79 of 100" in notes


def test_one_method_with_other_settings_is_no_mean():
    other = {"optimizer": {"lr": 1e-2}}
    runs = [learned(folder="one"), learned(seed=1, folder="two", **other)]
    message = (
        r"optimizer\.lr: 0\.001 in one, 0\.01 in two; .* means over runs with the same settings"
    )
    with pytest.raises(DeepringError, match=message):
        compare(runs)
    compare([learned(), learned("EgoNN", **other)])
    compare([learned(), learned(train=MULRAN, **other)])


def test_one_method_that_learns_nothing_with_other_settings_is_no_mean_either():
    fine = {"method_config": {"angles": 120}}
    coarse = {"method_config": {"angles": 60}}
    runs = [unlearned(folder="one", **fine), unlearned(seed=1, folder="two", **coarse)]
    with pytest.raises(DeepringError, match=r"RING\.angles: 120 in one, 60 in two"):
        compare(runs)
    compare([unlearned(**fine), unlearned(seed=1, optimizer={"lr": 7}, **fine)])


def test_the_same_case_and_seed_twice_is_refused_unless_the_figures_agree():
    runs = [learned(folder="one"), learned(home=0.75, folder="two")]
    message = (
        r"^DiSCO trained on sim_nclt, tested on sim_nclt test, seed 0: twice, with other figures: "
        r"Recall@1 0\.8 in one, 0\.75 in two; .* delete it$"
    )
    for mix in (False, True):
        with pytest.raises(DeepringError, match=message):
            compare(runs, mix=mix)
    slower = [replace(r, seconds_per_scan=1.0) for r in learned().results]
    again = [learned(), replace(learned(folder="again"), results=slower)]
    assert numbers(again)["DiSCO", NCLT, NCLT, "test"]["n"] == "1"


def test_a_radius_that_was_not_evaluated_is_named_with_those_that_were():
    message = r"radius 7 m: no result of RING, tested on sim_nclt test in RING-none-0; .*: 10;"
    with pytest.raises(DeepringError, match=message):
        compare([unlearned()], radius=7.0)
    with pytest.raises(DeepringError, match="runs: no result in any"):
        compare([])
    with pytest.raises(DeepringError, match=r"RING-none-0: seed None in its config"):
        compare([unlearned(seed=None, folder="RING-none-0")])


# Notes.


def test_notes_say_what_counts_and_whose_values_the_papers_are():
    grids = shown(sweep(seeds=(0, 1)), notes=["left out: x"])
    notes = grids["table1"].notes
    assert notes[0] == "mean ± sample standard deviation over the seeds 0, 1"
    assert "sim_nclt test: queries answerable: 80 of 100" in notes
    assert (
        "the paper's values are of the real datasets: NCLT beside sim_nclt, MulRan beside "
        "sim_mulran" in notes
    )
    assert notes[-1] == grids["table2"].notes[-1] == grids["crossing"].notes[-1] == "left out: x"


def test_answerable_queries_are_told_by_seed_where_they_differ():
    more = [replace(r, answerable=81) for r in learned(seed=1).results[:1]]
    notes = shown([learned(), run("DiSCO", NCLT, more, 1)])["table1"].notes
    assert "sim_nclt test: queries answerable: 80 of 100 (seed 0), 81 of 100 (seed 1)" in notes


def test_what_differs_from_the_original_stands_below_the_first_table():
    note = {"method_config": {"note": "own sparse convolutions; CPU-sized"}}
    quick = {"method_config": {"note": "20 rings", "label": "RING"}}
    grids = shown([learned("EgoNN", **note), learned("EgoNN", MULRAN, **note), unlearned(**quick)])
    notes = grids["table1"].notes
    assert "EgoNN: own sparse convolutions; CPU-sized" in notes
    assert "RING: 20 rings" in notes
    assert not any("sparse" in text for text in grids["table2"].notes)


def test_a_re_ranked_row_stands_below_its_method_and_beside_no_value_of_the_papers():
    def with_candidates_aligned(made):
        further = [
            replace(r, case=replace(r.case, method=f"{r.case.method} + pose re-ranking"))
            for r in made.results
        ]
        return replace(made, results=[*made.results, *further])

    runs = sweep()
    grid = shown([with_candidates_aligned(made) for made in runs])["table1"]
    of_first = texts(grid)[:6]
    assert [row[1] for row in of_first[::2]] == ["RING", "DiSCO", "DeepRING"]
    for own, reranked in zip(of_first[::2], of_first[1::2], strict=True):
        assert reranked[1] == f"{own[1]} + pose re-ranking"
        assert [own[column] for column in (3, 5, 7)] != [reranked[column] for column in (3, 5, 7)]
        assert {reranked[column] for column in (3, 5, 7)} == {"-"}


def test_the_papers_slips_are_named_where_they_are_shown():
    def slips(grid):
        return [note for note in grid.notes if "slip" in note]

    runs = sweep(methods=("DeepRING", "PointNetVLAD", "EgoNN"))
    grids = shown(runs)
    assert [note[:42] for note in slips(grids["table1"])] == [
        "the paper's F1 of PointNetVLAD on NCLT, 0.",
        "the paper's F1 of DeepRING on NCLT, 0.894,",
    ]
    assert slips(grids["table1"])[1].endswith(
        "0.894, looks like a slip: it lies below 2R/(1+R) = 0.924, which accepting every query "
        "gives for its Recall@1 of 0.859 where all are answerable"
    )
    (only,) = slips(grids["table2"])
    assert only.startswith("the paper's F1 of EgoNN on NCLT, 0.696, looks like a slip")
    assert not slips(shown([learned("DeepRING", MULRAN)])["table1"]), "not where they are not"


def test_versions_of_the_code_are_told():
    runs = [learned(), Run("other", learned("EgoNN").config, learned("EgoNN").results, [])]
    assert any("several versions of the code" in n for n in shown(runs)["table1"].notes)


@pytest.mark.parametrize("name", ["table1", "table2", "crossing", "costs"])
def test_latex_is_balanced(name):
    text = latex(shown(sweep(seeds=(0, 1)))[name])
    plain = re.sub(r"\\[{}]", "", text)
    assert plain.count("{") == plain.count("}")
    assert text.count(r"\begin{") == text.count(r"\end{") == 2
    (columns,) = re.findall(r"\\begin\{tabular\}\{(\w+)\}", text)
    rows = [line for line in text.splitlines() if line.endswith(r" \\")]
    assert rows
    assert all(line.count(" & ") == len(columns) - 1 for line in rows)
    assert "±" not in text
    assert not re.search(r"(?<!\\)[_%#]", text)


def test_markdown_is_one_table_a_grid():
    text = without_intervals(markdown([shown(sweep())["table1"]]))
    assert "| sim_nclt | RING | 0.700 | 0.664 |" in text
    assert "| **0.900** | 0.859 |" in text


# When it is a comparison.


def test_runs_of_another_method_or_tested_in_several_places_are_a_comparison():
    own = replace(learned("DeepRING"), results=learned("DeepRING").results[:1])
    ring = replace(own.results[0], case=Case("RING", "", NCLT, "test"))
    assert not is_comparison([own, replace(own, results=[*own.results, ring])])
    assert is_comparison([own, learned("DeepRING")])
    other = replace(learned("DiSCO"), results=learned("DiSCO").results[:1])
    assert is_comparison([other])
    assert is_comparison([own, other])


# The paper.


@pytest.fixture
def papers_tables():
    """Tables I and II as printed: Recall@1, F1 and AUC, on NCLT and then on MulRan."""
    return {
        "table1": """
            Scan Context & 0.469 & 0.638 & 0.570 & 0.584 & 0.737 & 0.698
            RING         & 0.664 & 0.798 & 0.839 & 0.713 & 0.833 & 0.843
            PointNetVLAD & 0.508 & 0.539 & 0.627 & 0.697 & 0.821 & 0.842
            DiSCO        & 0.793 & 0.887 & 0.849 & 0.743 & 0.863 & 0.897
            EgoNN        & 0.763 & 0.866 & 0.842 & 0.726 & 0.841 & 0.906
            DeepRING     & 0.859 & 0.894 & 0.893 & 0.893 & 0.943 & 0.943
        """,
        "table2": """
            Scan Context & 0.507 & 0.673 & 0.629 & 0.524 & 0.688 & 0.653
            RING         & 0.708 & 0.829 & 0.847 & 0.764 & 0.866 & 0.883
            PointNetVLAD & 0.369 & 0.539 & 0.626 & 0.561 & 0.719 & 0.722
            DiSCO        & 0.604 & 0.779 & 0.773 & 0.745 & 0.854 & 0.796
            EgoNN        & 0.562 & 0.696 & 0.799 & 0.663 & 0.797 & 0.850
            DeepRING     & 0.797 & 0.887 & 0.881 & 0.826 & 0.904 & 0.901
        """,
    }


def test_the_papers_values_are_those_of_its_tables(papers_tables):
    read = {}
    for table, text in papers_tables.items():
        for line in text.strip().splitlines():
            method, *rates = (cell.strip() for cell in line.split("&"))
            for known, three in (("NCLT", rates[:3]), ("MulRan", rates[3:])):
                read[table, known, method] = Rates(*map(float, three))
    assert len(read) == 24
    assert read == PAPER_RATES


def test_just_three_of_the_papers_values_are_slips_and_most_accept_every_query():
    slips = {key for key, rates in PAPER_RATES.items() if slip(rates) is not None}
    assert slips == {
        ("table1", "NCLT", "PointNetVLAD"),
        ("table1", "NCLT", "DeepRING"),
        ("table2", "NCLT", "EgoNN"),
    }
    equal = [r for r in PAPER_RATES.values() if abs(r.f1_max - 2 * r[0] / (1 + r[0])) < 1.1e-3]
    assert len(equal) == 18


def test_names_lead_to_the_papers_rows():
    assert [family(name) for name in ("sim_nclt", "MulRan_Sejong", "kitti", "nclt+mulran")] == [
        *("NCLT", "MulRan", None, None)
    ]
    rates = paper_rates("table1", "nclt", "Scan Context 120x120")
    assert (
        rates == paper_rates("table1", "sim_nclt", "Scan Context 120x120 ") == (0.469, 0.638, 0.570)
    )
    assert paper_rates("table1", "nclt", "DiSCO small").recall_1 == 0.793
    for label in ("Scan Context 20x60", "Scan Context", "RING++", "RING#", "Ring", "M2DP"):
        assert paper_rates("table1", "nclt", label) is None
    assert paper_rates("table2", "kitti", "RING") is None


def test_data_that_a_run_does_not_use_clashes_with_nothing():
    elsewhere = dataset(NCLT, 0, root="elsewhere")
    compare([unlearned(data=elsewhere), learned(train_data={NCLT: dataset(NCLT, 0)})])
    # It is used where the training or the test names no other.
    for runs in (
        [unlearned(data=elsewhere, test_data={}), unlearned("Mine")],
        [learned(data=elsewhere), unlearned()],
    ):
        with pytest.raises(DeepringError, match=r"data sim_nclt root .*'elsewhere'"):
            compare(runs)
