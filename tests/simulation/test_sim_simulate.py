"""A data set on disk: the same bytes each time, resumable, never written over something else."""

import hashlib
import json
import multiprocessing
import time
from dataclasses import replace

import pytest

from deepring.errors import DeepringError
from deepring.simulation.manifest import NAME, claim
from deepring.simulation.presets import preset, tiny, with_knobs
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.simulate import session_names, simulate

FEW = {name: replace(tiny(name), scan_spacing=25.0) for name in ("nclt", "mulran")}


def digest(root):
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    root = simulate(FEW["nclt"], tmp_path_factory.mktemp("whole") / "sim")
    return root, digest(root)


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_tiny_has_enough_scans_in_little_time(name, tmp_path):
    begun = time.process_time()
    root = simulate(tiny(name), tmp_path / "sim")
    assert time.process_time() - begun < 5.0
    counts = json.loads((root / "simulation.json").read_text())["scans"]
    assert len(counts) == 2
    assert all(60 <= count <= 150 for count in counts.values())


def test_same_seed_same_bytes(whole, tmp_path):
    assert digest(simulate(FEW["nclt"], tmp_path / "sim")) == whole[1]


def test_another_seed_gives_other_scans(whole, tmp_path):
    other = digest(simulate(replace(FEW["nclt"], seed=1), tmp_path / "sim"))
    assert not set(other.values()) & set(whole[1].values())


def test_workers_do_not_change_the_bytes(whole, tmp_path):
    assert digest(simulate(FEW["nclt"], tmp_path / "sim", workers=2)) == whole[1]


def test_progress_counts_all_scans(tmp_path):
    seen = []
    simulate(FEW["nclt"], tmp_path / "sim", progress=lambda done, total: seen.append((done, total)))
    total = seen[0][1]
    assert seen == [(i + 1, total) for i in range(total)]


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_lost_files_are_written_again(name, tmp_path):
    root = simulate(FEW[name], tmp_path / "sim")
    before = digest(root)
    scans = sorted(p for p in root.rglob("*.bin"))
    for path in scans[::3]:
        path.unlink()
    seen = []
    simulate(FEW[name], root, progress=lambda *counts: seen.append(counts))
    assert len(seen) == len(scans[::3])
    assert seen[-1] == (len(scans), len(scans))
    assert digest(root) == before


@pytest.mark.parametrize("name", ["nclt", "mulran"])
def test_lost_poses_are_written_again(name, tmp_path):
    root = simulate(FEW[name], tmp_path / "sim")
    before = digest(root)
    for path in root.rglob("*.csv"):
        path.unlink()
    simulate(FEW[name], root)
    assert digest(root) == before


def _simulate_few(root):
    simulate(FEW["nclt"], root)


def test_a_killed_run_goes_on(whole, tmp_path):
    root = tmp_path / "sim"
    process = multiprocessing.get_context("spawn").Process(target=_simulate_few, args=(root,))
    process.start()
    while process.is_alive() and len(list(root.rglob("*.bin"))) < 3:
        time.sleep(0.002)
    process.kill()
    process.join()
    process.close()
    simulate(FEW["nclt"], root)
    left = {k: v for k, v in digest(root).items() if not k.endswith(".part")}
    assert left == whole[1]


def test_a_whole_data_set_is_left_alone(whole):
    root, before = whole
    times = {p: p.stat().st_mtime_ns for p in root.rglob("*")}
    calls = []
    assert simulate(FEW["nclt"], root, progress=lambda *a: calls.append(a)) == root
    assert not calls
    assert times == {p: p.stat().st_mtime_ns for p in root.rglob("*")}
    assert digest(root) == before


def test_other_settings_are_refused_by_name(whole):
    root, before = whole
    with pytest.raises(DeepringError, match=r"movers is 14.0 there and 3.0 here"):
        simulate(replace(FEW["nclt"], movers=3.0), root)
    assert digest(root) == before


def test_of_many_other_settings_a_few_are_named(tmp_path):
    claim(tmp_path, FEW["nclt"])
    manifest = json.loads((tmp_path / NAME).read_text(encoding="utf-8"))
    manifest["settings"] = {}
    (tmp_path / NAME).write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(DeepringError, match=r"azimuths is None there .*; and \d+ more\. Nothing"):
        claim(tmp_path, FEW["nclt"])


def test_a_foreign_folder_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(DeepringError, match=r"non-empty folder without a simulation\.json"):
        simulate(FEW["nclt"], tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_file_or_a_broken_manifest_is_refused(tmp_path):
    file = tmp_path / "file"
    file.write_text("x")
    with pytest.raises(DeepringError, match="is a file"):
        simulate(FEW["nclt"], file)
    folder = tmp_path / "folder"
    folder.mkdir()
    for text, complaint in (("{", "not JSON"), ("[]", "no settings")):
        (folder / "simulation.json").write_text(text)
        with pytest.raises(DeepringError, match=complaint):
            simulate(FEW["nclt"], folder)
    assert len(list(folder.iterdir())) == 1


def test_the_manifest_tells_what_made_it(whole):
    manifest = json.loads((whole[0] / "simulation.json").read_text())
    assert SimulationSettings(**manifest["settings"]) == FEW["nclt"]
    assert manifest["complete"] is True
    names = {f"{name}/velodyne_sync" for name in session_names(FEW["nclt"])}
    assert set(manifest["scans"]) == names


@pytest.mark.parametrize(
    ("knobs", "complaint"),
    [
        ({"movers": -1.0}, r"movers: -1\.0, expected a number from 0\.0"),
        ({"azimuths": 3.5}, r"azimuths: 3\.5, expected a whole number"),
        ({"layout": "kitti"}, r"layout: 'kitti', expected one of nclt, mulran"),
        ({"tilt": 2.0}, r"knob: 'tilt', expected one of layout, seed"),
        ({"world_seed": -4}, r"world_seed: -4"),
        ({"reversed_share": float("nan")}, r"reversed_share: nan"),
        ({"seed": True}, r"seed: True"),
    ],
)
def test_bad_knobs_are_named(knobs, complaint):
    with pytest.raises(DeepringError, match=complaint):
        with_knobs(preset("nclt"), knobs)


def test_bad_preset_and_workers_are_named(tmp_path):
    with pytest.raises(DeepringError, match="preset: 'kitti'"):
        preset("kitti")
    with pytest.raises(DeepringError, match="workers: 0"):
        simulate(FEW["nclt"], tmp_path / "sim", workers=0)
