"""The command line as a user types it: what works, and each mistake as one clear error."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from functools import partial

import pytest
import torch

from deepring import __version__
from deepring.cli.commands import COMMANDS
from deepring.experiment.status import read_status
from helpers.cli import DEEPRING, SMALL, deepring, deepring_process, refused


def test_the_installed_command_says_what_there_is(tmp_path):
    done = deepring_process("--help", cwd=tmp_path)
    assert done.returncode == 0
    assert all(command in done.stdout for command in COMMANDS)
    assert deepring_process("--version", cwd=tmp_path).stdout == f"deepring {__version__}\n"


def test_no_command_and_an_unknown_one_are_mistakes(tmp_path):
    assert deepring(cwd=tmp_path).returncode == 2
    refused(deepring("trane", cwd=tmp_path), "trane: no such command, expected train, evaluate")
    refused(deepring("map", "bild", cwd=tmp_path), "COMMAND: 'bild', expected one of", "'build'")
    refused(deepring("map", cwd=tmp_path), "missing: COMMAND")
    refused(deepring("data", "check", ".", "--fast", cwd=tmp_path), "unknown: --fast")


def test_train_then_evaluate_its_checkpoint_then_resume(tiny_nclt, tmp_path):
    done = deepring("train", "experiment=demo", f"data.root={tiny_nclt}", *SMALL, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Recall@1" in done.stdout
    assert "outputs/demo/" in done.stdout
    run = tmp_path / "outputs" / "demo" / "latest"
    names = {"config.yaml", "versions.json", "results.csv", "results.md", "figures", "tensorboard"}
    assert names <= {p.name for p in run.iterdir()}

    checkpoint = "outputs/demo/latest/checkpoints/best.ckpt"
    options = [f"checkpoint={checkpoint}", f"data.root={tiny_nclt}", "evaluation.figures=false"]
    options.append("evaluation.rerank=[]")
    again = deepring("evaluate", *options, "evaluation.radii=[25]", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "25 m" in again.stdout
    assert (tmp_path / "outputs" / "evaluations" / "evaluate" / "latest").is_dir()

    before, last = run.resolve(), run / "checkpoints" / "last.ckpt"
    state, config = torch.load(last, weights_only=True), (run / "config.yaml").read_text()
    resume = ["resume=outputs/demo/latest/checkpoints/last.ckpt", f"data.root={tiny_nclt}"]
    epochs = ["trainer.max_epochs=2", "sampling.per_epoch=3", "evaluate=false"]
    more = deepring("train", "experiment=demo", *SMALL, *resume, *epochs, cwd=tmp_path)
    assert more.returncode == 0, more.stderr
    assert run.resolve() == before
    further = torch.load(last, weights_only=True)
    assert further["epoch"] > state["epoch"]
    # One episode, then three; a fresh start would take six.
    assert (state["global_step"], further["global_step"]) == (1, 1 + 3)
    # The run's folder keeps the first config and adds the one it went on with.
    (resumed,) = before.glob("config_resumed_*.yaml")
    assert (run / "config.yaml").read_text() == config
    assert "max_epochs: 1\n" in config
    assert "max_epochs: 2\n" in resumed.read_text()


MISTAKES = [
    (["data=nclt"], ["data.root"]),
    (["data=nclt", "data.root=nowhere"], ["nowhere"]),
    (["data=ncltt", "data.root=x"], ["ncltt", "sim_nclt"]),
    (["data.rooot=x"], ["rooot"]),
    (["data.spacing.query=far"], ["data.spacing.query", "far"]),
    (["checkpoint=gone.ckpt", "data.root={tiny}"], ["gone.ckpt"]),
    (["data.root={tiny}", "data.database='1999-01-01'"], ["1999-01-01", "2031-02-04"]),
    (["data.root={tiny}", "data=sim_mulran"], ["nclt"]),
    (
        ["data.root={tiny}", "data.regions.test=[{{disc: {{center: [9e4, 0], radius: 5}}}}]"],
        ["data.regions.test", "spans"],
    ),
    (["data.root={tiny}", "data.regions.test=[{{disc: {{center: [9e4]}}}}]"], [", expected"]),
    (["data.root={tiny}", "evaluation.regions=[moon]"], ["evaluation.regions", "moon"]),
    (["data.root={tiny}", "evaluation.radii=[-1]"], ["evaluation.radii"]),
    (["data.root={tiny}", "+methods.ring.foo=1"], ["methods.ring", "foo"]),
    (["data.root={tiny}", "methods.ring.raster.cells=abc"], ["raster.cells", "abc"]),
    (["data.root={tiny}", "methods.ring.raster.extent=100"], ["preprocessing.extent"]),
    (["data.root={tiny}", "seed=-1"], ["seed"]),
    (["data.root={tiny}", "paths.outputs=/dev/null/x"], ["/dev/null/x"]),
]


@pytest.mark.parametrize(("overrides", "words"), MISTAKES, ids=[str(w) for _, w in MISTAKES])
def test_mistakes_of_evaluate_are_one_error_each(overrides, words, tiny_nclt, tmp_path):
    filled = [override.format(tiny=tiny_nclt) for override in overrides]
    refused(deepring("evaluate", *filled, cwd=tmp_path), *words)


def test_data_check_reports_and_tells_by_its_exit_code(tiny_nclt, tmp_path):
    good = deepring("data", "check", tiny_nclt, cwd=tmp_path)
    assert good.returncode == 0
    assert "2031-02-04" in good.stdout

    broken = tmp_path / "broken"
    shutil.copytree(tiny_nclt, broken)
    for scan in (broken / "2031-02-04" / "velodyne_sync").glob("*.bin"):
        scan.write_bytes(b"")
    assert deepring("data", "check", broken, cwd=tmp_path).returncode != 0
    refused(deepring("data", "check", tmp_path / "nowhere", cwd=tmp_path), "nowhere")


def test_a_few_broken_scans_are_left_out_and_counted(tiny_nclt, tmp_path):
    damaged = tmp_path / "damaged"
    shutil.copytree(tiny_nclt, damaged)
    scans = sorted((damaged / "2031-03-17" / "velodyne_sync").glob("*.bin"))
    scans[-1].write_bytes(b"")
    scans[-2].write_bytes(scans[-2].read_bytes()[:1001])
    report = deepring("data", "check", damaged, cwd=tmp_path)
    assert report.returncode == 1
    assert scans[-1].name in report.stdout
    quick = ("evaluation.figures=false", "evaluation.rerank=[]")
    done = deepring("evaluate", f"data.root={damaged}", *quick, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "2 broken" in done.stdout + done.stderr


def test_simulate_resumes_and_never_overwrites(tmp_path):
    tiny = ["rows=2", "train_columns=2", "test_columns=2", "block=45", "crossing_jitter=3"]
    coarse = ["azimuths=240", "scan_spacing=20"]
    command = ["simulate", "nclt", "-o", "world", *tiny, *coarse]
    assert deepring(*command, cwd=tmp_path).returncode == 0
    scans = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.bin")}
    assert scans
    assert deepring(*command, cwd=tmp_path).returncode == 0
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.bin")} == scans
    refused(deepring(*command, "--seed", 7, cwd=tmp_path), "--output: world")
    refused(deepring(*command, "blok=3", cwd=tmp_path), "blok", "block")
    refused(deepring(*command, "rows=two", cwd=tmp_path), "rows", "two")


@pytest.mark.slow  # two nodes of one process each do the same
def test_two_processes_train_one_network(tiny_nclt, tmp_path):
    options = [*SMALL, "trainer.accelerator=cpu", "trainer.devices=2", "trainer.strategy=ddp"]
    done = deepring_process(
        "train", "experiment=demo", f"data.root={tiny_nclt}", *options, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    runs = [p for p in (tmp_path / "outputs" / "demo").iterdir() if not p.is_symlink()]
    assert len(runs) == 1
    assert {"results.csv", "config.yaml"} <= {p.name for p in runs[0].iterdir()}
    assert done.stdout.count("results      ") == 1


#: Each way to start the command but the installed one, from another folder than the sources'.
STARTS = (
    ("-m", "deepring"),
    ("-m", "deepring.cli.main"),
    ("-c", "from deepring.cli.main import main; main()"),
)


@pytest.mark.parametrize("start", STARTS)
def test_the_module_is_the_command(start, tmp_path):
    done = subprocess.run(
        [sys.executable, *start, "--version"], cwd=tmp_path, capture_output=True, check=True
    )
    assert done.stdout.decode() == f"deepring {__version__}\n"


def test_a_further_process_is_started_as_a_file_with_the_modules_of_the_first(tmp_path):
    """What Lightning starts for each further process of a distributed training."""
    (tmp_path / "mine.py").write_text("FOUND = True\n", encoding="utf-8")
    (tmp_path / "start.py").write_text(
        """
import sys
from deepring.cli.ddp import restartable
from lightning.fabric.strategies.launchers.subprocess_script import _basic_subprocess_cmd
import json, os, subprocess
sys.argv[1:] = ["--cfg", "job"]
sys.path.insert(0, os.getcwd())
with restartable(["--cfg=job", "data=sim_nclt", "seed=7"]):
    command = _basic_subprocess_cmd()
shown = subprocess.run(command, cwd="/", capture_output=True, check=True, text=True).stdout
assert "seed: 7" in shown
print(command[1], os.environ["DEEPRING_DDP_PATHS"])
""",
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-m", "start"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    script, paths = done.stdout.split(maxsplit=1)
    assert script.endswith("further_process.py")
    assert str(tmp_path) in paths.strip().split(os.pathsep)


@pytest.mark.slow
@pytest.mark.parametrize("start", STARTS)
def test_two_processes_of_a_module_train_one_network(start, tiny_nclt, tmp_path):
    options = [*SMALL, "trainer.accelerator=cpu", "trainer.devices=2", "trainer.strategy=ddp"]
    root = os.path.relpath(tiny_nclt, tmp_path)
    words = ["train", "experiment=demo", f"data.root={root}", *options, "evaluation.figures=false"]
    done = subprocess.run(
        [sys.executable, *start, *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("results      ") == 1
    assert "rank" in (done.stderr + done.stdout).lower()


@pytest.mark.slow
def test_two_nodes_train_one_network(tiny_nclt, tmp_path):
    """As on a cluster: the same command on each node, which finds the others by its environment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = [*SMALL, "trainer.accelerator=cpu", "trainer.num_nodes=2", "trainer.strategy=ddp"]
    command = [
        DEEPRING,
        *("train", "experiment=demo", f"data.root={tiny_nclt}", "hydra.run.dir=outputs/both"),
        *options,
    ]
    nodes = [
        subprocess.Popen(
            [str(word) for word in command],
            cwd=tmp_path,
            env={
                **os.environ,
                **{"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)},
                **{"WORLD_SIZE": "2", "NODE_RANK": str(rank), "LOCAL_RANK": "0"},
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for rank in (0, 1)
    ]
    said = [node.communicate(timeout=200) for node in nodes]
    assert [node.returncode for node in nodes] == [0, 0], said
    assert [out.count("results      ") for out, _ in said] == [1, 0]
    folder = tmp_path / "outputs" / "both"
    assert {"results.csv", "config.yaml", "status.json"} <= {p.name for p in folder.iterdir()}


def test_an_interrupted_training_says_how_to_go_on_and_does(tiny_nclt, tmp_path):
    options = ["experiment=demo", f"data.root={tiny_nclt}", *SMALL, "evaluation.figures=false"]
    long = [DEEPRING, "train", *options, "trainer.max_epochs=5000"]
    # Where the suite itself runs in the background, SIGINT would be inherited as ignored.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen(
        long,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed,  # noqa: PLW1509
    ) as running:
        checkpoint = tmp_path / "outputs" / "demo" / "latest" / "checkpoints" / "last.ckpt"
        for _ in range(600):
            if checkpoint.is_file() or running.poll() is not None:
                break
            time.sleep(0.1)
        running.send_signal(signal.SIGINT)
        try:
            _, errors = running.communicate(timeout=60)
        finally:
            running.kill()
    assert running.returncode == 130, errors
    assert "Traceback" not in errors
    assert "resume=outputs/demo/" in errors
    assert read_status(checkpoint.parents[1].resolve()).state == "interrupted"
    epoch = torch.load(checkpoint, weights_only=True)["epoch"]
    resume = f"resume={checkpoint.relative_to(tmp_path)}"
    further = deepring("train", *options, resume, f"trainer.max_epochs={epoch + 2}", cwd=tmp_path)
    assert further.returncode == 0, further.stderr
    assert (tmp_path / "outputs" / "demo" / "latest" / "results.csv").is_file()
