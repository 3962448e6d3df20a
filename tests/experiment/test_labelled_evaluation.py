"""Methods that need classes of points, through the command line."""

from dataclasses import replace

import pytest

from deepring.methods.network_file import load_network
from deepring.simulation.presets import tiny
from deepring.simulation.simulate import simulate
from helpers.cli import deepring
from helpers.small_training import TINY_DATA, TINY_METHODS

#: A tiny training, and neither pictures nor further methods.
QUICK = (
    *("trainer.max_epochs=1", "trainer.log_every_n_steps=1", "callbacks.progress=null"),
    *("evaluation.figures=false", "evaluation.descriptors=true", "methods.ring=null"),
    *("methods.scan_context=null", "methods.scan_context_120=null"),
)


@pytest.fixture(scope="module")
def labelled_drive(tmp_path_factory):
    settings = replace(tiny("custom"), labels=True)
    return simulate(settings, tmp_path_factory.mktemp("labelled") / "custom") / "drive.yaml"


def test_a_network_of_classes_trains_and_its_descriptors_are_scored_by_none(
    labelled_drive, tmp_path
):
    options = ("method=rinet", "data=sim_custom", f"data.root={labelled_drive}")
    tiny_rinet = (*TINY_METHODS["rinet"], *TINY_DATA, *QUICK)
    done = deepring("train", *options, *tiny_rinet, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (checkpoint,) = tmp_path.rglob("best.ckpt")
    assert load_network(checkpoint).method.settings.label == "RINet"
    # It compares by its weights, which exported descriptors do not have.
    (run,) = {path.parent for path in tmp_path.rglob("*query*.safetensors")}
    scored = deepring("score", str(run), cwd=tmp_path)
    assert scored.returncode != 0
    assert "compares with its weights, which are not in the files" in scored.stderr
    assert "Traceback" not in scored.stderr


@pytest.mark.parametrize("method", ["ssc", "rinet"])
def test_a_dataset_without_labels_is_refused_in_one_line(method, tiny_custom, tmp_path):
    drive = f"data.root={tiny_custom / 'drive.yaml'}"
    done = deepring("train", f"method={method}", "data=sim_custom", drive, *TINY_DATA, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert line.startswith("error: session map: its points have no labels in ")
    assert "Traceback" not in done.stderr


def test_relative_poses_are_stated_where_a_method_tells_them(labelled_drive, tmp_path):
    drive = ("method=ssc", "data=sim_custom", f"data.root={labelled_drive}", *QUICK)
    options = (*TINY_DATA, "evaluation.descriptors=false", "method.raster.count=500")
    done = deepring("train", *drive, *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "relative poses of the best places within 10 m" in done.stdout
    (table,) = tmp_path.rglob("relative_poses.csv")
    ssc = table.read_text().splitlines()[1].split(",")
    assert ssc[0].startswith("SSC")
    places, right = map(int, ssc[5:7])
    assert 0 <= right <= places
    assert "within 2 m and 5°" in (table.parent / "results.md").read_text()
    quiet = deepring("train", *drive, *options, "evaluation.relative_poses=false", cwd=tmp_path)
    assert quiet.returncode == 0, quiet.stderr
    assert "relative poses" not in quiet.stdout
    assert len(list(tmp_path.rglob("relative_poses.csv"))) == 1
