"""Train and evaluate from the real configs: every experiment file, and a whole small run."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from packaging.version import Version
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from deepring.errors import DeepringError
from deepring.evaluation.results import COLUMNS, read_results
from deepring.experiment.config_groups import config_folder
from deepring.experiment.evaluate import evaluate
from deepring.experiment.plan import plan_evaluation
from deepring.experiment.train import train
from deepring.methods.network_file import load_network
from helpers.small_training import SMALL, TINY_DATA

#: The experiments that train, by the command in their second line.
EXPERIMENTS = sorted(
    path.stem
    for path in (config_folder() / "experiment").glob("*.yaml")
    if path.read_text().splitlines()[1].startswith("# deepring train ")
)
WORLDS = [
    (line.split()[0], line.split()[1].removeprefix("world="))
    for line in (config_folder() / "worlds" / "weights.txt").read_text().splitlines()
]

MANY_WORLDS = [
    f"train_data.{world}_{seed}.{key}={value}"
    for seed, world in WORLDS
    for key, value in (
        ("root", "{tiny_custom}/drive.yaml"),
        ("regions.validation_share", 0.3),
        ("regions.margin", 1),
        ("spacing.train", 1),
    )
]

#: How each experiment is pointed at small data; the fixtures' folders are filled in.
POINTED = {
    "demo": ["data.root={tiny_nclt}"],
    "demo_worlds": ["data.root={tiny_nclt}"],
    "paper_nclt": [
        "data.root={tiny_nclt}",
        "data.database='2031-02-04'",
        "data.query='2031-03-17'",
        "data.regions.train=[{{half_plane: {{point: [0, 0], normal: [-1, 0]}}}}]",
        "data.regions.test=[{{half_plane: {{point: [150, 0], normal: [1, 0]}}}}]",
        "evaluate=false",
    ],
    "many_worlds": [
        *MANY_WORLDS,
        *(f"test_data.campus_{seed}.root={{tiny_nclt}}" for seed in (110, 111)),
        *(f"test_data.city_{seed}.root={{tiny_mulran}}" for seed in (110, 111)),
    ],
    "weights": MANY_WORLDS,
    "paper_mulran": [
        "data.root={tiny_mulran}",
        "data.database=SimCity01",
        "data.query=SimCity02",
        "data.regions.train=[{{half_plane: {{point: [345000, 0], normal: [-1, 0]}}}}]",
        "data.regions.test=[{{half_plane: {{point: [345150, 0], normal: [1, 0]}}}}]",
        "evaluate=false",
    ],
    "kitti": [
        "data.root={tiny_kitti}",
        "train_data.sim_nclt.root={tiny_nclt}",
        "train_data.sim_nclt.regions.margin=1",
        "train_data.sim_nclt.regions.validation_share=0.3",
        "train_data.sim_mulran.regions.validation_share=0",
        "train_data.sim_mulran.root={tiny_mulran}",
    ],
}


#: The figures of one test set and of several; those of `demo` are `small_run`'s.
DRAWN = ("kitti", "many_worlds")


def pointed(experiment, request):
    names = ("tiny_nclt", "tiny_mulran", "tiny_custom", "tiny_kitti")
    roots = {name: request.getfixturevalue(name) for name in names}
    return [override.format(**roots) for override in POINTED[experiment]]


def test_every_experiment_file_is_tried():
    assert set(EXPERIMENTS) == set(POINTED)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_each_experiment_runs_and_names_its_command(experiment, composed, request, tmp_path):
    lines = (config_folder() / "experiment" / f"{experiment}.yaml").read_text().splitlines()
    assert lines[1].startswith(f"# deepring train experiment={experiment}")
    overrides = pointed(experiment, request)
    if experiment not in DRAWN:
        overrides.append("evaluation.figures=false")
    small = SMALL
    if POINTED[experiment][: len(MANY_WORLDS)] == MANY_WORLDS:  # nothing takes data= there
        small = [override for override in SMALL if not override.startswith("data.")]
    cfg = composed(f"experiment={experiment}", "debug=fast", *small, *overrides)
    trained = train(cfg, tmp_path / "run")
    assert load_network(trained.checkpoint).trained_on
    assert bool(trained.results) == cfg.evaluate


@pytest.fixture(scope="module")
def small_run(compose_in, tiny_nclt, tmp_path_factory):
    """A whole training on the tiny streets, two epochs of two episodes."""
    outputs = tmp_path_factory.mktemp("outputs")
    cfg = compose_in(
        outputs,
        "experiment=demo",
        f"data.root={tiny_nclt}",
        "trainer.max_epochs=2",
        "trainer.log_every_n_steps=1",
        "callbacks.progress=null",
        *SMALL,
        "evaluation.rerank=[pose]",
    )
    return cfg, train(cfg, outputs / "run")


def test_a_run_leaves_everything_that_reproduces_it(small_run):
    folder = small_run[1].folder
    assert (folder.parent / "latest").resolve() == folder
    versions = json.loads((folder / "versions.json").read_text())
    assert versions["seed"] == 0
    assert Version(versions["packages"]["torch"]).public == Version(torch.__version__).public
    assert "clearance: 0.5" in (folder / "config.yaml").read_text()
    assert {p.name for p in (folder / "checkpoints").iterdir()} == {
        "best.ckpt",
        "last.ckpt",
    }
    results = read_results(folder / "results.csv")
    assert (folder / "results.csv").read_text().splitlines()[0] == ",".join(COLUMNS)
    methods = ("DeepRING", "RING", "Scan Context 20x60", "Scan Context 120x120")
    names = [name for method in methods for name in (method, f"{method} + pose re-ranking")]
    assert list(dict.fromkeys(r.case.method for r in results)) == names
    assert {r.radius_m for r in results} == {5, 10, 15, 20, 25}
    pictures = {p.name for p in (folder / "figures").glob("*.png")}
    assert {"pr_curves.png", "recall_by_radius.png", "hits_DeepRING.png"} <= pictures
    assert sum(name.startswith("sinogram") for name in pictures) == 3


def test_tensorboard_holds_scalars_figures_curves_and_hyperparameters(small_run):
    tags = EventAccumulator(str(small_run[1].folder / "tensorboard")).Reload().Tags()
    tags = {kind: set(tags[kind]) for kind in ("scalars", "images", "tensors")}
    assert {"train/loss", "train/accuracy", "train/W", "val/sim_nclt/recall@1"} <= tags["scalars"]
    assert "test/sim_nclt/test/recall@1/DeepRING" in tags["scalars"]
    assert {"curves/pr_curves", "hits/RING"} <= tags["images"]
    assert {"train/lr", "train/epoch"} <= tags["scalars"]
    assert "epoch" not in tags["scalars"]
    assert "test/sim_nclt/test/DeepRING" in tags["tensors"]
    assert "hp_metric" not in tags["scalars"]


def test_evaluating_the_checkpoint_again_gives_the_same_figures(small_run, tmp_path):
    cfg, trained = small_run
    cfg = replace(cfg, evaluation=replace(cfg.evaluation, figures=False))
    again = evaluate(plan_evaluation(cfg, trained.checkpoint), tmp_path / "again").results
    for a, b in zip(trained.results, again, strict=True):
        assert (a.case, a.radius_m, a.recall_1, a.auc) == (
            b.case,
            b.radius_m,
            b.recall_1,
            b.auc,
        )


def test_how_good_at_25_m_over_all_queries_needs_no_code(composed, tiny_nclt, tmp_path):
    choice = ("evaluation.radii=[25]", "evaluation.over=all", "evaluation.figures=false")
    choice += ("evaluation.rerank=[]",)
    cfg = composed(f"data.root={tiny_nclt}", *choice, name="evaluate")
    results = evaluate(plan_evaluation(cfg), tmp_path / "run").results
    assert [r.radius_m for r in results] == [25, 25, 25]
    assert "all queries" in (tmp_path / "run" / "results.md").read_text()


def test_ways_that_the_region_cannot_hold_are_refused(composed, tiny_nclt, tmp_path):
    cfg = composed(f"data.root={tiny_nclt}", *SMALL, "sampling.ways=500")
    with pytest.raises(DeepringError, match=r"sampling\.ways: 500"):
        train(cfg, tmp_path / "run")


def test_resume_from_nothing_is_refused_before_anything_is_written(composed, tiny_nclt, tmp_path):
    cfg = composed(f"data.root={tiny_nclt}", f"resume={tmp_path / 'no.ckpt'}")
    with pytest.raises(DeepringError, match="resume"):
        train(cfg, tmp_path / "run")
    assert not Path(tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("data.regions.test=[{disc: {center: [9e3, 9e3], radius: 5}}]", r"data\.regions\.test"),
        ("+methods.ring.foo=1", r"methods\.ring\.foo: unknown, expected one of angles"),
        ("trainer.precision=bf16-true", r"trainer\.precision"),
        ("trainer.max_epochs=two", r"trainer\.max_epochs: 'two', expected a whole number"),
        ("checkpoint=best.ckpt", r"checkpoint: best\.ckpt, expected null in a training; .*resume"),
    ],
)
def test_what_would_fail_after_training_fails_before(
    override, complaint, composed, tiny_nclt, tmp_path
):
    with pytest.raises(DeepringError, match=complaint):
        train(composed(f"data.root={tiny_nclt}", *SMALL, override), tmp_path / "run")
    assert not (tmp_path / "run" / "checkpoints").exists()


def test_training_on_what_is_tested_is_refused(composed, tiny_nclt, tmp_path, caplog):
    regions = ["data.regions.train=null", "data.regions.test=null"]
    cfg = composed(f"data.root={tiny_nclt}", "debug=fast", *SMALL, *regions)
    with pytest.raises(DeepringError, match="overlap=allow"):
        train(cfg, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_two_training_sets_of_one_name_are_refused(composed, tiny_nclt, tmp_path):
    twice = [f"+data@train_data.{k}=sim_nclt" for k in "ab"]
    roots = [f"train_data.{k}.root={tiny_nclt}" for k in "ab"]
    with pytest.raises(DeepringError, match="do not differ in name"):
        train(composed(f"data.root={tiny_nclt}", *twice, *roots), tmp_path / "run")


def test_resuming_another_network_is_refused_and_changes_nothing(small_run, composed, tiny_nclt):
    folder = small_run[1].folder
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    checkpoint = folder / "checkpoints" / "last.ckpt"
    cfg = composed(
        "experiment=demo",
        f"data.root={tiny_nclt}",
        *SMALL,
        "method.encoder.widths=[4,8]",
        f"resume={checkpoint}",
    )
    with pytest.raises(DeepringError, match=r"resume: .* other encoder.widths"):
        train(cfg, folder)
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before


def test_an_evaluation_records_the_checkpoints_model(small_run, composed, tiny_nclt, caplog):
    options = [f"data.root={tiny_nclt}", "preprocessing=band"]
    cfg = composed(*options, name="evaluate")
    plan = plan_evaluation(cfg, small_run[1].checkpoint)
    assert cfg.method is None
    recorded = plan.record["method"]
    assert recorded["_target_"] == "deepring.methods.deepring.DeepRing"
    assert recorded["encoder"]["widths"] == [8, 16, 32]
    assert recorded["representation"]["pool"] == 2
    assert plan.record["preprocessing"]["clearance"] is None
    assert plan.network.raster.preprocessing.clearance == 0.5  # not the config's band
    assert "keeps that of its checkpoint" in caplog.text


@pytest.mark.parametrize(("region", "warned"), [("test", False), ("whole", True)])
def test_evaluating_where_it_was_trained_is_said(
    region, warned, small_run, composed, tiny_nclt, caplog
):
    options = [f"data.root={tiny_nclt}", *TINY_DATA, f"evaluation.regions=[{region}]"]
    plan_evaluation(composed(*options, name="evaluate"), small_run[1].checkpoint)
    assert ("how well it remembers" in caplog.text) == warned


def test_a_refused_training_leaves_latest_where_it_was(small_run, compose_in, tiny_nclt):
    latest = small_run[1].folder.parent / "latest"
    before = latest.resolve()
    cfg = compose_in(before.parent, f"data.root={tiny_nclt}", *SMALL, "sampling.ways=500")
    with pytest.raises(DeepringError, match=r"sampling\.ways"):
        train(cfg, before.parent / "refused")
    assert latest.resolve() == before


RING_ALONE = ("methods.scan_context=null", "methods.scan_context_120=null")


@pytest.mark.parametrize(("which", "methods"), [(0, RING_ALONE), (0.5, ()), (1, RING_ALONE)])
def test_a_query_that_cannot_be_decoded_is_left_out_everywhere(
    which, methods, composed, tiny_kitti, tmp_path, caplog
):
    damaged = tmp_path / "damaged"
    shutil.copytree(tiny_kitti, damaged)
    options = ("data=kitti", f"data.root={damaged}", "evaluation.regions=[whole]")
    cfg = composed(*options, *methods, "evaluation.rerank=[]", name="evaluate")
    query = plan_evaluation(cfg).splits[0].query
    scan = query.session.files[query.indices[int(which * (len(query) - 1))]]
    scan.write_bytes(bytes(1600))  # a hundred records without one valid point
    results = evaluate(plan_evaluation(cfg), tmp_path / "run").results
    assert {result.queries for result in results} == {len(query) - 1}
    assert scan.name in caplog.text
    assert len(list((tmp_path / "run" / "figures").glob("sinogram*.png"))) == 3
