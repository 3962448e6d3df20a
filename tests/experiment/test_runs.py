"""Run folders: which are found, which are left out and why, and what cannot be read."""

import json

import pytest
from omegaconf import OmegaConf

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.results import write_results
from deepring.experiment.record import record_of
from deepring.experiment.runs import find_runs, read_run
from deepring.experiment.status import Status, write_status
from deepring.paper.ablation import ablation_tables
from deepring.paper.ablation_tables import shown_table
from helpers.results import result_of

RESULT = result_of(Case("DeepRING", "sim", "sim", "test"), 10.0)


def run_folder(folder, config=None, status=None, commit="c0ffee"):
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(
        OmegaConf.to_yaml({"seed": 3} if config is None else config)
    )
    (folder / "versions.json").write_text(json.dumps({"git_commit": commit}))
    write_status(folder, status or Status("finished"))
    write_results(folder / "results.csv", [RESULT])
    return folder


def names(found):
    return [run.folder.rpartition("/")[2] for run in found.runs]


def test_a_run_is_read_as_plain_values(tmp_path):
    config = {"seed": 3, "optimizer": {"lr": 1e-4}, "encoder": {"widths": [8, 16]}, "resume": None}
    run = read_run(run_folder(tmp_path / "one", config))
    assert run.config == config
    assert type(run.config["encoder"]["widths"]) is list
    assert (list(run.results), run.commits) == ([RESULT], ["c0ffee"])


def test_the_training_time_is_the_statuss(tmp_path):
    timed = run_folder(tmp_path / "timed", status=Status("finished", score=0.5, seconds=90.5))
    assert read_run(timed).seconds == 90.5
    assert read_run(run_folder(tmp_path / "not")).seconds is None


def test_a_status_of_before_there_was_a_time_has_none(tmp_path):
    folder = run_folder(tmp_path / "old")
    (folder / "status.json").write_text('{"state": "finished", "error": null, "score": 0.5}')
    assert read_run(folder).seconds is None
    (folder / "status.json").write_text('{"state": "finished", "seconds": "long"}')
    with pytest.raises(DeepringError, match=r"status\.json: seconds: 'long', expected a number"):
        read_run(folder)


def test_runs_are_found_at_any_depth_in_order_and_a_run_by_itself(tmp_path):
    for name in ("sweep/b", "sweep/a", "sweep/deep/er/c"):
        run_folder(tmp_path / name)
    (tmp_path / "sweep/figures").mkdir()
    assert names(find_runs([tmp_path])) == ["a", "b", "c"]
    assert names(find_runs([str(tmp_path / "sweep/b")])) == ["b"]


def test_a_run_that_several_paths_lead_to_is_taken_once(tmp_path):
    run_folder(tmp_path / "a")
    (tmp_path / "latest").symlink_to("a", target_is_directory=True)
    assert names(find_runs([tmp_path])) == ["a"]
    assert names(find_runs([tmp_path, tmp_path / "a", tmp_path / "latest"])) == ["a"]


def test_hidden_folders_are_not_searched(tmp_path):
    run_folder(tmp_path / "a")
    run_folder(tmp_path / ".trash/b")
    assert names(find_runs([tmp_path])) == ["a"]


def test_failed_unfinished_and_unevaluated_runs_are_left_out_and_listed(tmp_path):
    sweep = tmp_path / "sweep"
    run_folder(sweep / "a")
    run_folder(sweep / "b", status=Status("failed", error="out of memory\nat line 3"))
    run_folder(sweep / "c", status=Status("running"))
    (run_folder(sweep / "d") / "results.csv").unlink()
    found = find_runs([sweep])
    assert names(found) == ["a"]
    assert found.notes == [
        "left out: sweep/b: failed: out of memory",
        "left out: sweep/c: unfinished: still running, or killed",
        "left out: sweep/d: not evaluated (evaluate=false): no results.csv",
    ]


def test_the_config_of_a_run_that_did_not_finish_may_be_half_written(tmp_path):
    run_folder(tmp_path / "a")
    (run_folder(tmp_path / "b", status=Status("running")) / "config.yaml").write_text("{")
    assert names(find_runs([tmp_path])) == ["a"]


def test_commits_of_a_run_that_went_on_are_all_known(tmp_path):
    folder = run_folder(tmp_path / "a", commit=None)
    (folder / "versions_resumed_x.json").write_text('{"git_commit": "beef+"}')
    assert read_run(folder).commits == ["beef+"]
    (folder / "versions.json").unlink()
    assert read_run(folder).commits == ["beef+"]


def test_nothing_to_show_says_what_was_expected(tmp_path):
    with pytest.raises(DeepringError, match="absent: no such folder; expected a sweep's"):
        find_runs([tmp_path / "absent"])
    with pytest.raises(DeepringError, match=r"no run in it .*status\.json"):
        find_runs([tmp_path])
    run_folder(tmp_path / "a", status=Status("failed", error="broke"))
    message = r"no run with results; .*/a: failed: broke; start the same"
    with pytest.raises(DeepringError, match=message):
        find_runs([tmp_path])


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("config.yaml", "{", r"config\.yaml: .*expected the config of a run"),
        ("config.yaml", "- a", r"config\.yaml: holds a list"),
        ("config.yaml", "a: ${b}", r"config\.yaml: .*expected the config"),
        ("config.yaml", "a: ${oc.env:HOME}", r"config\.yaml: .*of plain values"),
        ("config.yaml", "a: !!timestamp 'x'", r"config\.yaml: .*of plain values"),
        ("config.yaml", f"a: {'9' * 5000}", r"config\.yaml: .*of plain values"),
        ("config.yaml", f"a: {'[' * 3000}{']' * 3000}", r"config\.yaml: .*of plain values"),
        ("config.yaml", "method: DeepRING", r"config\.yaml: config\.method: 'DeepRING', expected"),
        ("config.yaml", "test_data: {a: 3}", r"config\.yaml: config\.test_data\.a: 3, expected"),
        (
            "config.yaml",
            "evaluation: {radii: x}",
            r"config\.evaluation\.radii: 'x', expected",
        ),
        ("config.yaml", None, r"config\.yaml: cannot be read"),
        ("results.csv", "a,b\n", r"results\.csv: header"),
        ("versions.json", "{}", r"versions\.json: no git_commit"),
        ("versions.json", '{"git_commit": []}', r"versions\.json: git_commit: a list"),
        ("status.json", "{", r"status\.json"),
        ("status.json", '{"error":' * 3000, r"status\.json: JSON: nested too deeply"),
        ("status.json", '{"state": "finished", "score": NaN}', r"JSON: NaN, expected finite"),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, file, content, message):
    path = run_folder(tmp_path / "a") / file
    path.unlink() if content is None else path.write_text(content)
    with pytest.raises(DeepringError, match=message):
        find_runs([tmp_path])


def test_aliases_of_aliases_are_not_written_out(tmp_path):
    folder = run_folder(tmp_path / "a")
    rows = ["&a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    rows += [f"&a{k} [{', '.join(10 * [f'*a{k - 1}'])}]" for k in range(1, 12)]
    (folder / "config.yaml").write_text(f"a: [{', '.join(rows)}]")
    with pytest.raises(DeepringError, match=r"config\.yaml: is not YAML of plain values"):
        read_run(folder)


def test_every_variant_that_can_be_trained_has_its_row(compose_in, tmp_path):
    rows = {
        "ours": ("Ours", "SG", "DFT", "CE"),
        "pg": ("Representation", "PG", "DFT", "CE"),
        "range_image": ("Representation", "RI", "DFT", "CE"),
        "multi_gap": ("Aggregation", "SG", "Multi-GAP", "CE"),
        "gap": ("Aggregation", "SG", "GAP", "CE"),
        "gmp": ("Aggregation", "SG", "GMP", "CE"),
        "triplet": ("Loss", "SG", "DFT", "Triplet"),
        "triplet_dft2": ("Loss", "SG", "2DFT", "Triplet"),
        "quadruplet": ("Loss", "SG", "DFT", "Quadruplet"),
    }
    for variant in rows:
        cfg = compose_in(tmp_path / "outputs", "experiment=demo", f"variant={variant}")
        run_folder(tmp_path / variant, record_of(cfg))
    (table,) = ablation_tables(find_runs([tmp_path]).runs)
    assert {tuple(entry.names.values()) for entry in table.entries} == set(rows.values())
    grid = shown_table(table)
    assert grid.headers[-2:] == ["Recall@1", "paper"], "no further key varies"
    paper = [row[-1].text for row in grid.rows]
    assert paper == ["0.834", "-", "0.534", "0.639", "0.743", "0.644", "-", "0.747", "0.859"]
