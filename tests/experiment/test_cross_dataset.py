"""Trained on one dataset and tested on another: nothing of the test set enters the training."""

import numpy as np
import pytest
import torch

from deepring.errors import DeepringError
from deepring.evaluation.descriptors import read_descriptors
from deepring.experiment import build
from deepring.experiment.plan import plan_evaluation
from deepring.experiment.train import check_overlap, train
from deepring.training.datamodule import PlaceDataModule

NARROW = ("spacing.train=1", "regions.validation_share=0.3", "regions.margin=1")
EPISODE = ("sampling.ways=2", "sampling.queries=1", "sampling.per_epoch=2")


@pytest.fixture
def crossing(composed, tiny_nclt, tiny_mulran):
    """Train on the campus, test on both."""
    roots = {"sim_nclt": tiny_nclt, "sim_mulran": tiny_mulran}

    def make(*overrides, train="sim_nclt", test="[sim_nclt,sim_mulran]"):
        pointed = [
            f"{side}_data.{name}.{key}"
            for side, names in (("train", train), ("test", test))
            for name in names.strip("[]").split(",")
            for key in (f"root={roots[name]}", *NARROW)
        ]
        return composed(
            *("method=deepring_small", f"train={train}", f"test={test}", *EPISODE, *pointed),
            *(
                "trainer.max_epochs=1",
                "trainer.log_every_n_steps=1",
                "callbacks.progress=null",
                "evaluation.figures=false",
                "evaluation.rerank=[]",
            ),
            *("methods.scan_context=null", "methods.scan_context_120=null", *overrides),
        )

    return make


def files(scans):
    return {scans.session.files[k].resolve() for k in scans.indices}


def test_regions_and_sessions_of_training_and_test_are_disjoint(crossing):
    cfg = crossing("evaluation.regions=[test,whole]", "overlap=leave_out")
    both = datasets, _ = build.datasets(cfg)
    trained = set().union(*(files(scans) for d in datasets for scans in d.training()))
    validated = set()
    for dataset in datasets:
        held_out = dataset.retrieval("validation")
        validated |= files(held_out.database) | files(held_out.query)
    assert not trained & validated
    seen = []
    for split in plan_evaluation(cfg, datasets=both, after=True).splits:
        tested = files(split.database) | files(split.query)
        if tested & (trained | validated):
            seen.append((split.name, split.region))
            continue
        same_dataset = [d for d in datasets if d.name == split.name]
        for d in same_dataset:  # another region: no scan of it nearer than the gap
            for scans in d.training():
                for side in (split.database, split.query):
                    offset = scans.positions[:, None] - side.positions[None]
                    assert np.linalg.norm(offset, axis=-1).min() > 20
    assert seen == [("sim_nclt", "whole")]


def test_the_test_set_changes_nothing_of_the_training(crossing, tmp_path):
    folders = alone, beside = tmp_path / "alone", tmp_path / "beside"
    options = ["evaluate=false"], ["evaluation.regions=[test,whole]", "overlap=leave_out"]
    alone, beside = (
        train(crossing(f"paths.run={folder}", *chosen), folder)
        for folder, chosen in zip(folders, options, strict=True)
    )
    weights = [
        torch.load(run.checkpoint, weights_only=True)["state_dict"] for run in (alone, beside)
    ]
    assert all(torch.equal(weights[0][key], weights[1][key]) for key in weights[0])
    places = {(r.case.method, r.case.test, r.case.region) for r in beside.results}
    assert ("DeepRING", "sim_nclt", "test") in places
    assert ("DeepRING", "sim_mulran", "whole") in places
    assert ("DeepRING", "sim_nclt", "whole") not in places  # it was trained there
    assert ("RING", "sim_nclt", "whole") in places
    assert {r.case.train for r in beside.results if r.case.method == "DeepRING"} == {"sim_nclt"}
    names = {path.name for path in (tmp_path / "beside" / "retrievals").iterdir()}
    assert "DeepRING__sim_mulran__whole.csv" in names
    assert not (tmp_path / "beside" / "descriptors").exists()


def test_only_training_scans_reach_the_training(crossing, monkeypatch, tmp_path):
    """The episodes' positions are the training scans' and no others."""
    points = []
    setup = PlaceDataModule.setup

    def spy(self, stage):
        setup(self, stage)
        points.append(self.train_set.places.points)

    monkeypatch.setattr(PlaceDataModule, "setup", spy)
    cfg = crossing("evaluate=false")
    train(cfg, tmp_path / "run")
    dataset = build.datasets(cfg)[0][0]
    expected = np.concatenate([scans.positions for scans in dataset.training()])
    positions = points[0][:, :2] + dataset.database.positions[0]
    assert np.allclose(np.sort(positions, axis=0), np.sort(expected, axis=0))
    assert set(points[0][:, 2]) == {0.0}


def test_overlap_is_refused_left_out_or_allowed(crossing, caplog):
    cfg = crossing("evaluation.regions=[whole]")
    datasets, _ = build.datasets(cfg)
    splits = plan_evaluation(cfg, after=True).splits
    with pytest.raises(DeepringError, match="overlap=allow"):
        check_overlap(cfg.overlap, datasets, splits)
    with caplog.at_level("INFO"):
        check_overlap("leave_out", datasets, splits)
    assert "sim_nclt whole holds training scans: it is left out" in caplog.text


def test_kept_descriptors_carry_what_they_were_made_of(crossing, tmp_path):
    cfg = crossing("evaluation.descriptors=true", test="sim_mulran", train="sim_nclt")
    train(cfg, tmp_path / "run")
    path = tmp_path / "run" / "descriptors" / "DeepRING__sim_mulran__test__query.safetensors"
    kept = read_descriptors(path)
    assert kept.case.train == "sim_nclt"
    assert kept.made_by["settings"]["representation"]["pool"] == 2


def test_one_dataset_twice_is_refused(composed, tiny_nclt):
    twice = [f"+data@test_data.{k}=sim_nclt" for k in "ab"]
    roots = [f"test_data.{k}.root={tiny_nclt}" for k in "ab"]
    with pytest.raises(DeepringError, match="test_data: sim_nclt, sim_nclt do not differ"):
        build.datasets(composed(*twice, *roots))
