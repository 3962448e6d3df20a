"""A method that needs classes of points, through the command line."""

from helpers.cli import deepring
from helpers.small_training import TINY_DATA


def test_a_dataset_without_labels_is_refused_in_one_line(tiny_custom, tmp_path):
    drive = f"data.root={tiny_custom / 'drive.yaml'}"
    done = deepring("train", "method=ssc", "data=sim_custom", drive, *TINY_DATA, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert line.startswith("error: session map: its points have no labels in ")
    assert "Traceback" not in done.stderr
