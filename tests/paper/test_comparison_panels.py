"""Which curve stands in which panel, and what is said of those that are lacking."""

import numpy as np
import torch

from deepring.evaluation.case import Case
from deepring.evaluation.counting import precision_recall
from deepring.evaluation.matches import TopMatches
from deepring.paper.comparison import compare
from deepring.paper.comparison_figures import curve_panels
from deepring.paper.seed_groups import Run
from helpers.results import result_of

TESTS = [(test, region) for test in ("sim_nclt", "sim_mulran") for region in ("test", "whole")]


def run(method, train, seed=0):
    """A run tested in both regions of both datasets."""
    target = "disco.Disco" if train else "ring.Ring"
    config = {"seed": seed, "method": {"_target_": f"deepring.methods.{target}"}}
    results = [result_of(Case(method, train, *test), 10.0, (50, 9, 5)) for test in TESTS]
    return Run(f"{method}-{train}-{seed}", config, results)


def matches(method, train, test, region, score=0.0):
    distance = np.array([[3.0], [12.0], [40.0]], dtype=np.float32)
    index = np.arange(3)
    scores = np.array([[score + 3], [2], [1]], dtype=np.float32)
    case, nearest = Case(method, train, test, region), distance[:, 0] / 2
    return TopMatches(case, index, index[:, None], scores, None, distance, nearest)


def panels(runs, retrieved, **kwargs):
    return curve_panels(compare(runs, **kwargs), retrieved)


RUNS = [run("DiSCO", "sim_nclt"), run("DiSCO", "sim_mulran"), run("RING", "")]
ALL = [(0, matches("RING", "", *test)) for test in TESTS] + [
    (0, matches("DiSCO", train, *test)) for train in ("sim_nclt", "sim_mulran") for test in TESTS
]


def test_a_panel_for_each_test_of_tables_one_and_two():
    made = panels(RUNS, ALL)
    assert {title: list(methods) for title, methods in made[0].items()} == {
        "sim_nclt, in-domain": ["RING", "DiSCO"],
        "sim_mulran, in-domain": ["RING", "DiSCO"],
        "sim_nclt, cross-domain": ["RING", "DiSCO"],
        "sim_mulran, cross-domain": ["RING", "DiSCO"],
    }
    assert made[1] == []


def test_the_curve_is_that_of_the_radius_shown():
    ((precision, recall),) = panels(RUNS, ALL)[0]["sim_nclt, in-domain"]["DiSCO"]
    _, retrieved = ALL[4]
    expected = precision_recall(retrieved, 10.0)
    assert torch.equal(precision, expected[0])
    assert torch.equal(recall, expected[1])
    assert not torch.equal(precision, precision_recall(retrieved, 15.0)[0])


def test_the_first_of_a_seed_is_taken_and_other_seeds_are_passed_over():
    test = ("RING", "", "sim_nclt", "test")
    retrieved = [(0, matches(*test)), (0, matches(*test, score=-3)), (7, matches(*test))]
    (curve,) = panels(RUNS, retrieved)[0]["sim_nclt, in-domain"]["RING"]
    assert torch.equal(curve[0], precision_recall(matches(*test), 10)[0])


def test_each_seed_has_its_curve_and_what_lacks_one_is_named():
    runs = [*RUNS, run("RING", "", 1)]
    retrieved = [*ALL[:4], (1, matches("RING", "", "sim_nclt", "test"))]
    made = panels(runs, retrieved)
    assert len(made[0]["sim_nclt, in-domain"]["RING"]) == 2
    assert len(made[0]["sim_nclt, cross-domain"]["RING"]) == 1
    assert "RING, tested on sim_nclt whole, seed 1" in made[1]
    assert "DiSCO trained on sim_mulran, tested on sim_nclt whole, seed 0" in made[1]
    assert not any("sim_nclt test, seed 1" in text for text in made[1])


def test_without_any_there_is_no_panel():
    assert panels(RUNS, [])[0] == {}


def test_two_trainings_of_a_method_are_told_apart():
    runs = [*RUNS, run("DiSCO", "sim_kitti")]
    retrieved = [*ALL, (0, matches("DiSCO", "sim_kitti", "sim_nclt", "whole"))]
    assert list(panels(runs, retrieved)[0]["sim_nclt, cross-domain"]) == [
        *("RING", "DiSCO (sim_kitti)", "DiSCO (sim_mulran)")
    ]
