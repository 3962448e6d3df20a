"""A training that begins with an earlier stage's weights, and one that trains some parts alone."""

import logging

import pytest
import torch
from omegaconf import OmegaConf

from deepring.errors import DeepringError
from deepring.experiment.start import start_from
from deepring.experiment.train import train
from deepring.methods.network_file import load_network, load_stage, write_network
from deepring.methods.pointnetvlad import PointNetVlad, PointNetVladSettings
from deepring.rasters import PointsRaster, raster_settings
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


def test_the_three_stages_of_dh3d(compose_in, tiny_nclt, tmp_path):
    """Each begins with the last one's weights, and keeps those that it does not train."""
    network = [o for o in TINY_METHODS["dh3d"] if o.startswith("method.")]
    points = ("sampling.points=32", "sampling.around=4", "sampling.pairs=2", "sampling.per_epoch=1")
    tuples = [o for o in TINY_METHODS["dh3d"] if o.startswith("sampling.")]
    short = ("trainer.max_epochs=1", "callbacks.progress=null", "~logger", "evaluate=false")
    known, last = {}, None
    for stage, options, untrained in (
        ("local", points, ("detector", "place")),
        ("detector", points, ("place",)),
        ("place", tuples, ()),
    ):
        start = () if last is None else (f"start_from={last}",)
        overrides = ("method=dh3d", f"stage=dh3d_{stage}", *network, *options, *start, *short)
        cfg = compose_in(tmp_path / stage, f"data.root={tiny_nclt}", *TINY_DATA, *overrides)
        last = train(cfg, tmp_path / stage / "run").checkpoint
        trained = load_stage(last)
        assert trained.untrained == untrained
        weights = trained.method.state_dict()
        assert all(torch.equal(weights[name], weight) for name, weight in known.items())
        parts = set(trained.method.parts) - set(untrained)
        known = {name: w for name, w in weights.items() if name.split(".")[0] in parts}


def test_the_command_line_refuses_in_one_line(tmp_path):
    done = deepring("evaluate", "method=ring", "start_from=none.ckpt", cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "start_from: none.ckpt, expected null where nothing is trained" in line
