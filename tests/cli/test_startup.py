"""What a command imports: nothing heavy to say its help, and nothing that it does not use."""

import json
import subprocess
import sys

from deepring.cli.commands import COMMANDS
from helpers.cli import deepring

SUBCOMMANDS = {"map": ("build", "info", "calibrate", "merge"), "data": ("check",)}

HEAVY = ("torch", "lightning", "torchmetrics", "hydra", "omegaconf", "matplotlib", "tensorboard")

#: What maps, loops and exported weights do without. `loops` alone draws a picture. Sympy comes with
#: torch's compiler, which takes two seconds to import.
UNUSED = {"matplotlib", "lightning", "torchmetrics", "hydra", "omegaconf", "tensorboard", "sympy"}

#: Shows several helps, and tells what they imported.
HELP = """
import contextlib, io, json, sys
from deepring.cli.main import main

texts = []
for words in json.loads(sys.argv[1]):
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        main([*words, "--help"])
    texts.append(out.getvalue())
print(json.dumps([texts, sorted(sys.modules)]))
"""

#: Runs commands one after the other, and tells what had been imported after each.
RUN = """
import json, sys
from deepring.cli.main import main

for words in json.loads(sys.argv[1]):
    main(words)
    print("imported", json.dumps([words[0], sorted(sys.modules)]))
"""

#: Tells what torch itself loads for a layer without weights.
LAYER = """
import json, sys
import torch
with torch.device("meta"):
    torch.nn.Conv2d(1, 1, 1)
print(json.dumps(sorted(sys.modules)))
"""


def python(code, *arguments, cwd):
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_help_imports_nothing_heavy(tmp_path):
    families = [[name] for name in COMMANDS]
    families += [[name, inner] for name, inners in SUBCOMMANDS.items() for inner in inners]
    families.insert(0, [])
    (line,) = python(HELP, json.dumps(families), cwd=tmp_path)
    texts, modules = json.loads(line)
    for words, text in zip(families, texts, strict=True):
        assert text.startswith(" ".join(["usage: deepring", *words])), words
    loaded = {name.partition(".")[0] for name in modules}
    assert "deepring" in loaded
    assert not loaded & set(HEAVY)


def test_help_of_train_lists_the_groups_and_their_files(tmp_path):
    for command in ("train", "evaluate"):
        out = deepring(command, "--help", cwd=tmp_path).stdout
        lines = {line.split()[0]: line for line in out.splitlines() if line.startswith("  ")}
        assert "deepring_small" in lines["method"]
        assert "sim_mulran" in lines["data"]


def test_maps_need_neither_training_nor_metrics(tiny_nclt, tmp_path):
    drive = (str(tiny_nclt), "--session", "2031-02-04", "--spacing", "100")
    scan = next((tiny_nclt / "2031-02-04").rglob("velodyne_sync/*.bin"))
    (of_torch,) = python(LAYER, cwd=tmp_path)  # torch 2.4 loads sympy for it
    commands = [
        ("export", "shipped", "-o", "a.safetensors"),
        ("map", "build", *drive, "-o", "a.map"),
        ("localize", "a.map", str(scan), "--format", "nclt"),
        ("loops", *drive, "-o", "a"),
    ]
    lines = python(RUN, json.dumps(commands), cwd=tmp_path)
    imports = [json.loads(line[9:]) for line in lines if line.startswith("imported ")]
    assert [command for command, _ in imports] == [words[0] for words in commands]
    for command, modules in imports:
        loaded = {name.partition(".")[0] for name in modules} - {*json.loads(of_torch)}
        assert "torch" in modules
        assert not loaded & (UNUSED - ({"matplotlib"} if command == "loops" else set())), command
        assert "scipy.signal" not in modules
