"""`--as json` of every command: one object of its schema on standard output, and nothing else."""

import json

import pytest

from deepring.cli.commands import COMMANDS, command_line
from deepring.evaluation.results import COLUMNS, read_results, result_values
from deepring.localization.map import Map
from deepring.schemas import VERSIONS, schema_names
from helpers.cli import SMALL, deepring, refused
from helpers.schemas import expect_valid, of_schema

#: An evaluation of RING alone on the tiny streets.
RING = (
    *("evaluation.rerank=[]", "evaluation.figures=false"),
    *("~method@methods.scan_context", "~method@methods.scan_context_120"),
)
ALONE = ("~method@methods.ring", *RING[2:])
QUICK = ("method=ring", *RING[:2], *ALONE, "data.spacing.train=1")


@pytest.fixture(scope="module")
def there(tmp_path_factory):
    """A folder of the module, and what runs a command in it with ``--as json``."""
    folder = tmp_path_factory.mktemp("json")

    def run(name, *arguments, status=0, form="json"):
        done = deepring(*arguments, "--as", form, cwd=folder)
        assert done.returncode == status, done.stderr
        return of_schema(name, done.stdout)

    run.folder = folder
    return run


@pytest.fixture(scope="module")
def evaluated(tiny_nclt, there):
    options = ["data=sim_nclt", f"data.root={tiny_nclt}", "evaluation.descriptors=true"]
    return there("results", "evaluate", *options, *RING)


@pytest.fixture(scope="module")
def mapped(tiny_nclt, there):
    """A map of one drive with its points, ``a.map``, as it was told."""
    drive = (tiny_nclt, "--session", "2031-02-04", "--spacing", 20, "--points")
    return there("map", "map", "build", *drive, "-o", "a.map")


def test_an_evaluation_prints_the_rows_of_its_file(evaluated, there):
    rows = read_results(there.folder / evaluated["run"] / "results.csv")
    assert evaluated["results"] == [result_values(row) for row in rows]
    assert list(evaluated["results"][0]) == list(COLUMNS)
    assert (evaluated["radius_m"], evaluated["over"]) == (10.0, "answerable")
    assert evaluated["checkpoint"] is None
    assert all((there.folder / path).exists() for path in evaluated["written"])


def test_scores_tables_and_reports_follow_from_the_run(evaluated, there):
    run = evaluated["run"]
    scored = there("results", "score", run, "--radii", "10", "-o", "scored.csv")
    assert scored["written"] == ["scored.csv"]
    first = next(row for row in evaluated["results"] if row["radius_m"] == 10)
    assert scored["results"][0]["recall_1"] == first["recall_1"]
    tables = there("tables", "tables", run)
    assert {table["name"] for table in tables["shown"]} >= {"costs"} or tables["shown"]
    (full,) = (table for table in tables["numbers"] if table["name"] != "paired")
    assert first["recall_1"] in (
        row.get("recall_1_mean", row.get("recall_1")) for row in full["rows"]
    )
    assert full["rows"][0]["seeds"] == [0]
    assert all((there.folder / path).is_file() for path in tables["written"])
    assert there("written", "report", run)["written"] == [f"{run}/report.html"]


def test_what_the_commands_print_fits_80_columns(evaluated, mapped, tiny_nclt, there):
    run = evaluated["run"]
    scans = sorted((tiny_nclt / "2031-03-17" / "velodyne_sync").glob("*.bin"))[:2]
    located = ("localize", mapped["map"], *scans, "--format", "nclt")
    shown = {
        "R@1%": ("score", run),
        "Recall@1": ("tables", run),
        "found by": located,
        "inliers": (*located, "--refine"),
    }
    for word, command in shown.items():
        done = deepring(*command, cwd=there.folder, columns=80)
        assert done.returncode == 0, done.stderr
        assert word in done.stdout
        of_tables = [line for line in done.stdout.splitlines() if f"{run}/tables" not in line]
        assert max(map(len, of_tables)) <= 80, done.stdout
        assert "…" not in done.stdout


def test_a_training_prints_its_checkpoint_and_score(tiny_nclt, there):
    options = ["experiment=demo", f"data.root={tiny_nclt}", "evaluation.figures=false", *SMALL]
    trained = there("results", "train", *options, *ALONE)
    assert (there.folder / trained["checkpoint"]).is_file()
    assert 0 <= trained["score"] <= 1
    assert {row["method"] for row in trained["results"]} == {"DeepRING"}


def test_a_sweep_prints_how_each_job_ended(tiny_nclt, there):
    options = [f"data.root={tiny_nclt}", *QUICK, "seed=0,-1", "evaluate=true"]
    sweep = there("sweep", "train", "-m", *options, status=1)
    assert [job["state"] for job in sweep["jobs"]] == ["finished", "failed"]
    assert "at least 0" in sweep["jobs"][1]["error"]
    assert "tables" not in sweep
    assert (there.folder / sweep["sweeps"][0]).is_dir()


def test_a_comparison_prints_its_jobs_and_tables_as_one_object(tiny_nclt, there):
    options = ["--learned=", "--fixed", "ring", "--test", "sim_nclt", "--seeds", "0"]
    where = [f"test_data.sim_nclt.root={tiny_nclt}", "test_data.sim_nclt.spacing.train=1"]
    compared = there("sweep", "compare", *options, *where, *RING[:2])
    assert [job["state"] for job in compared["jobs"]] == ["finished"]
    assert compared["tables"]["numbers"][0]["rows"][0]["method"] == "RING"
    assert (there.folder / compared["page"]).is_file()


def test_maps_are_told_as_they_are(mapped, tiny_nclt, there):
    built = mapped
    place_map = Map.open(there.folder / "a.map")
    assert (built["places"], built["left_out"]) == (len(place_map), [])
    assert built["bytes"] == (there.folder / "a.map").stat().st_size
    assert built["trust"] == {"fit": place_map.thresholds.fit, "ratio": place_map.thresholds.ratio}
    shown = there("map", "map", "info", "a.map")
    assert shown == {key: value for key, value in built.items() if key != "left_out"}
    other = (tiny_nclt, "--session", "2031-03-17", "--spacing", 5)
    there("map", "map", "build", *other, "-o", "b.map")
    merged = there("map", "map", "merge", "a.map", "b.map", "-o", "both.map")
    assert merged["places"] > len(place_map)
    assert merged["frame"]["x"] == pytest.approx(0, abs=1)
    options = ("--within", 20, "--precision", 0.01)
    calibrated = there("map", "map", "calibrate", "a.map", *other, "-o", "c.map", *options)
    assert calibrated["map"] == "c.map"
    assert calibrated["calibration"]["scans"] > 0


def test_scans_are_located_as_one_object_or_as_a_line_each(mapped, tiny_nclt, there):
    folder = there.folder / "scans"
    folder.mkdir()
    found = sorted((tiny_nclt / "2031-02-04" / "velodyne_sync").glob("*.bin"))
    for scan in found[:2]:
        (folder / scan.name).write_bytes(scan.read_bytes())
    command = ("localize", mapped["map"], "scans", "--format", "nclt")
    located = there("locations", *command)
    assert (len(located["scans"]), located["failures"]) == (2, [])
    lines = deepring(*command, "--as", "jsonl", cwd=there.folder).stdout.splitlines()
    rows = [of_schema("location", line) for line in lines]
    assert [{k: v for k, v in row.items() if k != "schema"} for row in rows] == located["scans"]
    (folder / found[1].name).write_bytes(b"")
    partly = there("locations", *command, status=1)
    assert len(partly["scans"]) == len(partly["failures"]) == 1
    (folder / found[0].name).write_bytes(b"")
    nothing = there("locations", *command, status=2)
    assert (nothing["scans"], len(nothing["failures"])) == ([], 2)


def test_loops_print_what_they_write(tiny_nclt, there):
    drive = (tiny_nclt, "--session", "2031-02-04", "--spacing", 40)
    printed = there("loops", "loops", *drive, "-o", "drive")
    kept = json.loads((there.folder / "drive.json").read_text())
    expect_valid("loops", kept)
    assert printed == {**kept, "written": printed["written"]}
    assert "drive.json" in printed["written"]


def test_what_is_written_is_told(there):
    exported = there("written", "export", "shipped", "-o", "a.safetensors")
    assert exported == {
        "schema": "deepring.written/1",
        "command": "export",
        "written": ["a.safetensors"],
    }
    tiny = ["rows=2", "train_columns=2", "test_columns=2", "block=45", "crossing_jitter=3"]
    coarse = ["azimuths=120", "scan_spacing=40"]
    simulated = there("written", "simulate", "custom", "-o", "w", *tiny, *coarse)
    assert simulated["written"] == ["w"]
    checked = there("dataset_check", "data", "check", "w/drive.yaml")
    assert checked["status"] == 0


def test_a_case_study_prints_its_errors(tiny_nclt, there):
    study = there("case_study", "case-study", tiny_nclt, "--pairs", 1)
    assert {row["representation"] for row in study["errors"]} == {"SG", "PG", "RI"}
    assert study["pairs"] == 1


def test_a_mistake_leaves_standard_output_empty(there):
    done = refused(
        deepring("map", "info", "gone.map", "--as", "json", cwd=there.folder), "gone.map"
    )
    assert (done.returncode, done.stdout) == (2, "")
    wrong = refused(
        deepring("evaluate", "--as", "xml", cwd=there.folder), "--as: xml, expected one"
    )
    assert wrong.returncode == 2
    refused(deepring("train", "--as", cwd=there.folder), "--as: no value, expected one of table")
    config = deepring("train", "--cfg", "job", "--as", "json", cwd=there.folder)
    refused(config, "--as: json, expected only without flags")


def leaves(parser):
    """The parsers of all commands, with the words that name them."""
    actions = [action for action in parser._actions if hasattr(action, "choices")]
    inner = [action.choices for action in actions if isinstance(action.choices, dict)]
    if not inner:
        return {parser.prog: parser}
    return {name: leaf for one in inner[0].values() for name, leaf in leaves(one).items()}


def test_every_command_that_prints_results_has_json():
    found = leaves(command_line())
    assert {name.split()[1] for name in found} == set(COMMANDS)
    without = {
        name
        for name, leaf in found.items()
        if "json" not in (next((a.choices for a in leaf._actions if a.dest == "form"), ()) or ())
    }
    assert without == {"deepring schema", "deepring completion"}  # JSON itself, and a script


def test_each_schema_has_a_file_and_is_itself_valid():
    from jsonschema import Draft202012Validator

    from deepring.schemas import read_schema

    assert schema_names() == sorted(VERSIONS)
    for name in schema_names():
        schema = read_schema(name)
        Draft202012Validator.check_schema(schema)
        assert schema["$id"] == f"deepring.{name}/{VERSIONS[name]}"
