"""The link to the newest run."""

import shutil

from deepring.experiment.run_folder import link_latest


def test_latest_is_the_newest_run(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        link_latest(tmp_path / name)
        assert (tmp_path / "latest").resolve() == tmp_path / name
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "latest"]


def test_a_copy_that_followed_the_link_is_left_as_it_is(tmp_path, caplog):
    (tmp_path / "runs" / "a").mkdir(parents=True)
    (tmp_path / "runs" / "a" / "config.yaml").write_text("seed: 0\n")
    link_latest(tmp_path / "runs" / "a")
    runs = tmp_path / "copied"
    shutil.copytree(tmp_path / "runs", runs)  # "latest" is a folder now
    (runs / "b").mkdir()
    link_latest(runs / "b")
    assert (runs / "latest" / "config.yaml").read_text() == "seed: 0\n"
    assert sorted(path.name for path in runs.iterdir()) == ["a", "b", "latest"]
    assert "latest is a folder, not a link to the newest run" in caplog.text
