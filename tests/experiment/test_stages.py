"""A training that begins with an earlier stage's weights, and one that trains some parts alone."""

import json
import logging
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from deepring.errors import ConfigError, DeepringError, FileError, StoppedError
from deepring.experiment.config import Config
from deepring.experiment.record import record_of
from deepring.experiment.report import report
from deepring.experiment.run_folder import read_config
from deepring.experiment.runs import find_runs
from deepring.experiment.stages import (
    OF_STAGE,
    StageOutcome,
    last_checkpoint,
    run_of,
    stages_left,
    stages_of,
)
from deepring.experiment.start import start_from
from deepring.experiment.status import read_status
from deepring.experiment.sweep import run_job
from deepring.experiment.train import train
from deepring.io.strict_json import read_json
from deepring.methods.network_file import load_network, load_stage, write_network
from deepring.methods.pointnetvlad import PointNetVlad, PointNetVladSettings
from deepring.paper.seed_groups import Run
from deepring.rasters import PointsRaster, raster_settings
from deepring.training.correspondences import CorrespondenceSet
from helpers.cli import deepring
from helpers.small_training import TINY_DATA, TINY_METHODS

TINY = (
    *("method=pointnetvlad", *TINY_METHODS["pointnetvlad"], *TINY_DATA, "method.first=[8,8]"),
    *("method.transform_widths=[8]", "method.transform_hidden=[8]", "sampling.per_epoch=1"),
    *("trainer.max_epochs=1", "callbacks.progress=null", "~logger", "evaluate=false"),
)


@pytest.fixture(scope="module")
def first_stage(compose_in, tiny_nclt, tmp_path_factory):
    """PointNetVLAD's point features, trained alone."""
    outputs = tmp_path_factory.mktemp("first")
    cfg = compose_in(outputs, f"data.root={tiny_nclt}", *TINY, "trained_parts=[features]")
    return train(cfg, outputs / "run").checkpoint


def small(**changes):
    values = {"first": (8, 8), "second": (8, 8), "transform_widths": (8,), "transform_hidden": (8,)}
    raster = raster_settings(PointsRaster(count=64))
    return PointNetVlad(
        PointNetVladSettings(**{"raster": raster, "clusters": 2, **values, **changes})
    )


def numbers(module):
    return sum(weight.numel() for weight in module.parameters())


def test_a_part_alone_is_trained_and_the_checkpoint_knows_that_the_rest_is_not(first_stage, caplog):
    network = load_network(first_stage)
    assert network.untrained == ("aggregate",)
    assert "of PointNetVLAD the parts aggregate were not trained, and hold" in caplog.text
    # Batch norm of what is not trained has seen nothing, and its weights have not decayed.
    seen = {k: w for k, w in network.method.state_dict().items() if k.endswith("batches_tracked")}
    assert {(name.split(".")[0], int(count)) for name, count in seen.items()} == {
        ("features", 1),
        ("aggregate", 0),
    }
    assert torch.equal(network.method.aggregate.gate.norm.weight, torch.ones(256))


def test_a_stage_begins_with_the_weights_trains_the_rest_and_is_resumed_without_its_start(
    first_stage, composed, tiny_nclt, tmp_path, caplog
):
    caplog.set_level(logging.INFO)
    start = tmp_path / "start.ckpt"
    start.write_bytes(first_stage.read_bytes())
    stage = (f"start_from={start}", "trained_parts=[aggregate]", "seed=7", "data.name=elsewhere")
    cfg = composed(f"data.root={tiny_nclt}", *TINY, *stage)
    last = tmp_path / "run" / "checkpoints" / "last.ckpt"
    train(cfg, tmp_path / "run")
    before, network = load_stage(first_stage).method.state_dict(), load_network(last)
    after = network.method.state_dict()
    changed = {name.split(".")[0] for name in before if not torch.equal(before[name], after[name])}
    assert changed == {"aggregate"}
    assert network.untrained == ()
    assert network.trained_on == "sim_nclt+elsewhere"
    taken, every = numbers(network.method.features), numbers(network.method)
    assert f"{taken} of {every} weights are taken; aggregate begin anew" in caplog.text
    assert f"training {numbers(network.method.aggregate)} parameters" in caplog.text
    recorded = OmegaConf.load(tmp_path / "run" / "config.yaml")
    assert (recorded.start_from, list(recorded.trained_parts)) == (str(start), ["aggregate"])

    start.unlink()
    again = (*stage, "trainer.max_epochs=2", f"resume={last}")
    train(composed(f"data.root={tiny_nclt}", *TINY, *again), tmp_path / "run")
    assert load_network(last).untrained == ()
    assert torch.load(last, weights_only=True)["epoch"] == 1
    other = composed(f"data.root={tiny_nclt}", *TINY, *again, "trained_parts=[features]")
    with pytest.raises(
        DeepringError, match=r"resume: .* other trained_parts: .*now \['features'\]"
    ):
        train(other, tmp_path / "run")


def test_the_weights_that_fit_are_taken_and_what_begins_anew_is_named(first_stage, caplog):
    caplog.set_level(logging.INFO)
    method = small(second=(8, 12))
    before = start_from(method, str(first_stage))
    assert before == (("sim_nclt",), ())  # no part is complete
    assert "features.second.3, features.second.4, aggregate begin anew" in caplog.text
    assert "its features.second.3, features.second.4 do not fit, and are left" in caplog.text
    assert "settings that differ from its own: second [8, 8], now [8, 12]" in caplog.text
    first = load_stage(first_stage).method.state_dict()
    assert torch.equal(method.features.second[0].weight, first["features.second.0.weight"])


def test_an_exported_network_is_a_start_too_and_all_of_it_counts(first_stage, tmp_path, caplog):
    caplog.set_level(logging.INFO)
    network = load_stage(first_stage)
    write_network(tmp_path / "a.safetensors", network)
    method = small()
    assert start_from(method, str(tmp_path / "a.safetensors")).parts == ("features", "aggregate")
    assert "weights are taken; none begin anew" in caplog.text
    weights = network.method.state_dict()
    assert all(torch.equal(weights[name], w) for name, w in method.state_dict().items())


def test_what_cannot_begin_is_refused_and_changes_nothing(first_stage, tmp_path):
    (tmp_path / "junk.ckpt").write_bytes(b"junk")
    for checkpoint, changes, complaint in (
        (tmp_path / "none.ckpt", {}, r"start_from: checkpoint .*none\.ckpt: is no file"),
        (tmp_path / "junk.ckpt", {}, r"start_from: .*junk\.ckpt: is no whole checkpoint"),
        (
            first_stage,
            {"first": (5,), "second": (7,), "transform_widths": (9,), "transform_hidden": (11,)},
            r"holds no matrix of weights that fits: settings differ in first \[8, 8\], now \[5\]",
        ),
    ):
        method = small(**changes)
        before = {name: weight.clone() for name, weight in method.state_dict().items()}
        with pytest.raises(DeepringError, match=complaint):
            start_from(method, str(checkpoint))
        assert all(torch.equal(before[name], w) for name, w in method.state_dict().items())


@pytest.mark.parametrize(
    ("overrides", "complaint"),
    [
        (["trained_parts=[aggregate,head]"], r"\['aggregate', 'head'\], expected one or more of f"),
        (["trained_parts=[]"], r"trained_parts: \[\], expected one or more of features, aggregate"),
        (["method=disco"], r"start_from: .* of PointNetVLAD .*but method is DiSCO"),
        (["method=ring"], r"start_from: .*, expected null where nothing is trained"),
    ],
)
def test_what_does_not_go_together_is_refused_before_anything_is_made(
    overrides, complaint, first_stage, composed, tiny_nclt, tmp_path
):
    known = TINY if overrides[0].startswith("trained") else TINY_DATA
    start = (f"data.root={tiny_nclt}", f"start_from={first_stage}")
    with pytest.raises(DeepringError, match=complaint):
        train(composed(*known, *start, *overrides), tmp_path / "run")
    assert not (tmp_path / "run").exists()


#: DH3D at a tiny size, and a step of each of its stages.
NETWORK = [o for o in TINY_METHODS["dh3d"] if o.startswith("method.")]
POINTS = {"points": 32, "around": 4, "pairs": 2, "per_epoch": 1}
TUPLES = {"negatives": 2, "negative_radius": 20, "per_epoch": 2}
STAGES = {"dh3d_local": POINTS, "dh3d_detector": POINTS, "dh3d_place": TUPLES}
EPOCHS = {"dh3d_local": 1, "dh3d_detector": 2, "dh3d_place": 1}
ALONE = (
    "methods={ring: null, scan_context: null, scan_context_120: null}",
    *("evaluation.figures=false", "evaluation.relative_poses=false"),
)
SHORT = ("callbacks.progress=null", "~logger", "evaluate=false")


def in_stages(root, *overrides):
    """Overrides of a run in the stages of `STAGES`."""
    values = [
        f"+stages.{name}.{key}={value}" for name in STAGES for key, value in of_stage(name).items()
    ]
    return ("method=dh3d", f"data.root={root}", *TINY_DATA, *NETWORK, *values, *SHORT, *overrides)


def of_stage(name):
    values = {f"sampling.{key}": value for key, value in STAGES[name].items()}
    return {**values, "trainer.max_epochs": EPOCHS[name]}


def weights_of(checkpoint):
    return load_stage(checkpoint).method.state_dict()


def same(one, other):
    return all(torch.equal(one[name], weight) for name, weight in other.items())


@pytest.fixture(scope="module")
def three_runs(compose_in, tiny_nclt, tmp_path_factory):
    """DH3D's stages by three commands: the checkpoint that each chose."""
    outputs, checkpoints = tmp_path_factory.mktemp("three"), []
    for stage in STAGES:
        start = [f"start_from={checkpoints[-1]}"] if checkpoints else []
        options = [f"{key}={value}" for key, value in of_stage(stage).items()]
        overrides = ("method=dh3d", f"stage={stage}", *NETWORK, *options, *start, *SHORT)
        cfg = compose_in(outputs / stage, f"data.root={tiny_nclt}", *TINY_DATA, *overrides)
        checkpoints.append(train(cfg, outputs / stage / "run").checkpoint)
    return checkpoints


def test_each_stage_of_dh3d_keeps_the_weights_that_it_does_not_train(three_runs):
    known = {}
    for checkpoint, untrained in zip(
        three_runs, (("detector", "place"), ("place",), ()), strict=True
    ):
        trained = load_stage(checkpoint)
        assert trained.untrained == untrained
        weights = trained.method.state_dict()
        assert same(weights, known)
        parts = set(trained.method.parts) - set(untrained)
        known = {name: w for name, w in weights.items() if name.split(".")[0] in parts}


def test_one_run_in_stages_interrupted_within_one_ends_as_three_commands_do(
    three_runs, composed, tiny_nclt, tmp_path, caplog
):
    caplog.set_level(logging.INFO)
    run, batches, true = tmp_path / "run", [], CorrespondenceSet.__getitem__
    cfg = composed(*in_stages(tiny_nclt, "evaluate=true", *ALONE))

    def broken(self, index):
        batches.append(index)
        if len(batches) == 3:  # the second epoch of the second stage
            raise SystemExit  # how Lightning ends on Ctrl-C
        return true(self, index)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CorrespondenceSet, "__getitem__", broken)
        with pytest.raises(StoppedError, match="training was interrupted; go on") as stopped:
            run_job(cfg, run)
    assert read_status(run).state == "interrupted"
    assert run_of(Path(str(stopped.value).rpartition("resume=")[2])) == run
    score = run_job(cfg, run)

    lines = [line.partition(":")[0] for line in caplog.messages if line.startswith("stage ")]
    names = [f"stage {name}" for name in STAGES]
    assert lines == [*names[:2], *names[1:]]
    stages = [run / "stages" / "1_dh3d_local", run / "stages" / "2_dh3d_detector", run]
    for folder, alone in zip(stages, three_runs, strict=True):
        assert same(weights_of(folder / "checkpoints" / alone.name), weights_of(alone))
    assert load_network(run / "checkpoints" / "best.ckpt").untrained == ()
    status = read_status(run)
    ended = [read_json((folder / "stage.json").read_text()) for folder in stages[:2]]
    assert (status.state, status.score) == ("finished", score)
    assert status.seconds > sum(stage["seconds"] for stage in ended)
    (found,) = find_runs([run.parent]).runs
    assert found.folder == str(run)
    assert {result.case.method for result in found.results} == {"DH3D"}
    # What is recorded makes the same stages again, and the run's keys are those of the last one.
    recorded = read_config(run / "config.yaml")
    assert list(recorded["stages"]) == list(STAGES)
    assert recorded["stages"]["dh3d_local"]["sampling"]["points"] == 32
    assert recorded["sampling"] == recorded["stages"]["dh3d_place"]["sampling"]
    assert "dh3d_detector" in report(run)
    run_job(cfg, run)  # finished: skipped
    assert read_status(run) == status


def test_what_is_left_of_a_run_is_told_by_what_its_stages_left_behind(tmp_path):
    values = dict.fromkeys(OF_STAGE)
    cfg = Config(stages={"a": values, "b": values, "c": values}, start_from="given.ckpt")

    def left(resume=None):
        stages, ended = stages_left(replace(cfg, resume=resume), tmp_path)
        first = stages[0].cfg
        return [stage.name for stage in stages], first.resume, first.start_from, len(ended)

    def leave(folder):
        (folder / "checkpoints").mkdir(parents=True)
        (folder / "checkpoints" / "last.ckpt").touch()
        return str(folder / "checkpoints" / "last.ckpt")

    assert last_checkpoint(tmp_path) is None
    assert left() == (["a", "b", "c"], None, "given.ckpt", 0)
    first, second = tmp_path / "stages" / "1_a", tmp_path / "stages" / "2_b"
    of_a = leave(first)
    assert last_checkpoint(tmp_path) == Path(of_a)
    assert left(of_a) == (["a", "b", "c"], of_a, "given.ckpt", 0)
    stage = stages_of(cfg, tmp_path)[0]
    stage.end(StageOutcome("best.ckpt", 0.5, 3.0))
    chosen = str(first / "checkpoints" / "best.ckpt")
    assert left(of_a) == (["b", "c"], None, chosen, 1)  # broken off before its first epoch
    of_b = leave(second)
    assert left(of_a) == left(of_b) == (["b", "c"], of_b, chosen, 1)
    assert last_checkpoint(tmp_path) == Path(of_b)
    assert last_checkpoint(tmp_path) != Path(leave(tmp_path)) == last_checkpoint(tmp_path)
    with pytest.raises(ConfigError, match="expected a checkpoint of a stage"):
        left("other/last.ckpt")
    (first / "stage.json").write_text("{}")
    with pytest.raises(FileError, match=r"stage\.json: stage: lacks checkpoint"):
        left(of_a)


MISTAKES = [
    ("stage=dh3d_local", r"stage=dh3d_local: beside stages=\[dh3d_local,dh3d_place\]"),
    ("+stages.dh3d_local.data.root=x", r"stages\.dh3d_local: .*expected values by name"),
    ("+stages.dh3d_local.sampling.pointz=3", r"stages\.dh3d_local: sampling\.pointz: no such"),
    ("+stages.dh3d_place.trained_parts=[head]", r"stages\.dh3d_place: trained_parts: \['head"),
]


@pytest.mark.parametrize(("override", "complaint"), MISTAKES)
def test_a_mistake_in_a_stage_names_it_and_is_told_before_anything_is_made(
    override, complaint, composed, tiny_nclt, tmp_path
):
    known = ("method=dh3d", "stages=[dh3d_local,dh3d_place]", f"data.root={tiny_nclt}", *NETWORK)
    fits = ("+stages.dh3d_local.sampling.points=32", "evaluate=false", "logger=csv")
    with pytest.raises(DeepringError, match=complaint):
        train(composed(*known, *fits, override), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_methods_stages_are_its_default_and_one_of_them_alone_is_a_choice(composed, tmp_path):
    small = composed("method=dh3d_small", "trainer.max_epochs=3")
    assert [*small.stages] == [f"dh3d_{part}_small" for part in ("local", "detector", "place")]
    assert [stage["trainer"]["max_epochs"] for stage in small.stages.values()] == [3, 3, 3]
    assert small.evaluate
    assert small.trained_parts == ["place"]
    whole = composed("method=dh3d_small", "stage=dh3d_whole_small")
    assert whole.stages == {}
    assert whole.trained_parts == ["local", "place"]
    # Runs of several seeds, in their own folders, are one row of a table; other stages another.
    text, run = json.dumps(record_of(small)), f"{tmp_path / 'run'}"
    moved = json.loads(text.replace(run, "elsewhere").replace('"seed": 0', '"seed": 1'))
    assert run in text
    assert Run("", moved, []).setting == Run("", record_of(small), []).setting
    moved["stages"]["dh3d_local_small"]["trainer"]["max_epochs"] = 4
    assert Run("", moved, []).setting != Run("", record_of(small), []).setting


def test_the_command_line_refuses_in_one_line(tmp_path):
    done = deepring("evaluate", "method=ring", "start_from=none.ckpt", cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "start_from: none.ckpt, expected null where nothing is trained" in line
