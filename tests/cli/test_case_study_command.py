"""`deepring case-study`, called as the command line calls it."""

import csv
import shutil

import pytest

from deepring.errors import BrokenScanError, DeepringError
from helpers.cli import deepring, refused, work_of
from helpers.real_data import real_data

FILES = ["case_study.csv", "case_study.png", "case_study_error.png"]


def study(output, *arguments, pairs=2):
    work_of("case-study", *arguments, "--pairs", pairs, "-o", output)
    assert sorted(path.name for path in output.iterdir()) == FILES
    with (output / "case_study.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def mean(rows, name, kind, value):
    return next(
        float(row["mean"])
        for row in rows
        if (row["representation"], row["kind"], row["value"]) == (name, kind, value)
    )


def holds(rows):
    """What the paper's case study says."""
    assert mean(rows, "SG", "translation", "10") < 0.5 * mean(rows, "PG", "translation", "10")
    assert mean(rows, "SG", "rotation", "52.5") < 0.5 * mean(rows, "PG", "rotation", "52.5")


@pytest.fixture
def scan_files(tiny_nclt):
    scans = sorted((tiny_nclt / "2031-02-04" / "velodyne_sync").glob("*.bin"))
    return [scans[0], scans[-1]]


def test_a_simulated_nclt_dataset(tiny_nclt, tmp_path, capsys):
    rows = study(tmp_path / "out", tiny_nclt, pairs=6)
    holds(rows)
    assert mean(rows, "SG", "unrelated", "") > 0.2
    said = capsys.readouterr().out
    assert "2031-02-04" in said, "the session that was taken"
    assert "case_study.csv" in said


def test_a_simulated_mulran_dataset_with_its_session_named(tiny_mulran, tmp_path, capsys):
    holds(study(tmp_path / "out", tiny_mulran, "--session", "SimCity02"))
    assert "SimCity02" in capsys.readouterr().out


def test_single_scan_files(scan_files, tmp_path, capsys):
    rows = study(tmp_path / "two", "--format", "nclt", *scan_files)
    holds(rows)
    assert [row["kind"] for row in rows].count("unrelated") == 3
    rows = study(tmp_path / "one", "--format", "nclt", scan_files[0])
    assert "unrelated" not in {row["kind"] for row in rows}
    assert "left out" in capsys.readouterr().out


def test_the_same_seed_writes_the_same_bytes(scan_files, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        study(tmp_path / name, "--format", "nclt", *scan_files, "--seed", seed)
    a, b, c = ((tmp_path / name / "case_study.csv").read_bytes() for name in "abc")
    assert a == b != c


def test_methods_beside_the_representations(scan_files, tmp_path, capsys):
    chosen = ("--methods", "fast_histogram,scan_context", "--pairs", 2)
    work_of("case-study", "--format", "nclt", *scan_files, *chosen, "-o", tmp_path / "out")
    further = {"case_study_methods.csv", "case_study_methods.png"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*FILES, *further}
    said = capsys.readouterr().out
    assert "mean loss" in said
    assert "Scan Context" in said
    with (tmp_path / "out" / "case_study_methods.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert mean(rows, "Fast Histogram", "rotation", "97.5") < 0.01
    assert mean(rows, "Fast Histogram", "unrelated", "") == pytest.approx(1.0, abs=1e-5)
    assert mean(rows, "Scan Context 20x60", "translation", "20") > 0.1


def test_the_drawn_pair_moves_as_it_was_told(scan_files, tmp_path, capsys):
    still = ("--rotation", 0, "--translation", 0)
    study(tmp_path / "out", "--format", "nclt", scan_files[0], *still)
    assert "turned 0.0°, moved 0 m: SG 0.000, PG 0.000" in capsys.readouterr().out


def test_broken_scans_of_a_dataset_are_left_out_and_counted(tiny_nclt, tmp_path, capsys):
    damaged = tmp_path / "damaged"
    shutil.copytree(tiny_nclt / "2031-02-04", damaged / "2031-02-04")
    for truth in tiny_nclt.rglob("groundtruth_2031-02-04.csv"):
        shutil.copy(truth, damaged)
    scans = sorted(damaged.rglob("velodyne_sync/*.bin"))
    for path in scans[2:]:
        path.write_bytes(bytes(80))  # ten points in one far corner
    rows = study(tmp_path / "out", damaged, pairs=len(scans))
    assert {row["n"] for row in rows if row["kind"] != "unrelated"} == {"2"}
    assert f"{len(scans) - 2} broken scans" in capsys.readouterr().out

    for path in scans[:2]:
        path.write_bytes(bytes(80))
    with pytest.raises(DeepringError, match="none of its"):
        work_of("case-study", damaged, "-o", tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{scan}"], ["--format", "nclt"]),
        (["{scan}", "{root}", "--format", "nclt"], ["not a file"]),
        (["{scan}", "{scan}", "--format", "nclt"], ["twice"]),
        (["{scan}", "--format", "nclt", "--session", "x"], ["--session x"]),
        (["nowhere"], ["nowhere"]),
        (["{root}", "--session", "1999-01-01"], ["1999-01-01", "2031-02-04"]),
        (["{root}", "--format", "kitti"], ["NCLT"]),
        (["{root}", "--pairs", "0"], ["--pairs: 0"]),
        (["{root}", "--methods", "rign"], ["--methods: 'rign'", "ring_plus_plus"]),
        (["{root}", "--methods", "ssc"], ["--methods: ssc needs points with labels"]),
        (["{root}", "--checkpoint", "no.ckpt"], ["no.ckpt"]),
        (["{root}", "--seed", "-1"], ["--seed: -1"]),
        (["{root}", "--translation", "71"], ["--translation: 71", "70"]),
        (["{root}", "--translation", "nan"], ["--translation: nan"]),
        (["{root}", "--rotation", "inf"], ["--rotation: inf"]),
        (["{root}", "-o", "{scan}"], ["--output: ", "is a file"]),
    ],
)
def test_mistakes_are_named_and_write_nothing(arguments, words, tiny_nclt, scan_files, tmp_path):
    places = {"scan": scan_files[0], "root": tiny_nclt}
    filled = [argument.format(**places) for argument in arguments]
    output = [] if "-o" in filled else ["-o", tmp_path / "out"]
    refused(deepring("case-study", *filled, *output, cwd=tmp_path), *words)
    assert not list(tmp_path.iterdir())


def test_a_file_without_a_visible_point_is_named_with_its_format(tmp_path):
    path = tmp_path / "1.bin"
    path.write_bytes(bytes([1]) * 80)
    with pytest.raises(BrokenScanError, match=r"1\.bin: 10 points as nclt"):
        work_of("case-study", "--format", "nclt", path, "-o", tmp_path / "out")


def test_real_kitti_scans(tmp_path):
    rows = study(tmp_path / "folder", real_data("kitti00_south"), pairs=8)
    holds(rows)
    assert mean(rows, "SG", "translation", "20") < mean(rows, "SG", "unrelated", "")
    scans = sorted(real_data("kitti00_south", "velodyne").glob("*.bin"))
    holds(study(tmp_path / "files", "--format", "kitti", scans[0], scans[-1]))


def test_real_nclt_scans(tmp_path):
    scans = sorted(real_data("nclt_scans").glob("*.bin"))
    holds(study(tmp_path / "out", "--format", "nclt", *scans, pairs=4))
