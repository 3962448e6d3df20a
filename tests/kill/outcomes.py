"""What a command has written, in a form in which two runs can be compared."""

import hashlib
import json
from pathlib import Path

from deepring.evaluation.results import read_results
from deepring.methods.network_file import load_network


def contents(folder: Path) -> dict[str, str]:
    """SHA-256 of each file below a folder; hidden ones, such as locks and parts, are left out."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    }


def figures(folder: Path) -> dict[str, list[tuple]]:
    """The rates of each run below a folder, without its times, and its matches."""
    rates = {
        str(path.parent.relative_to(folder)): [
            (r.case, r.radius_m, r.recall_1, r.recall_5, r.f1_max, r.auc)
            for r in read_results(path)
        ]
        for path in sorted(folder.rglob("results.csv"))
    }
    matches = {
        str(path.relative_to(folder)): [path.read_text()]
        for path in sorted(folder.rglob("retrievals/*"))
    }
    return rates | matches


def parts(folder: Path) -> list[Path]:
    """Files that hold the first part of another file's content."""
    return sorted(folder.rglob(".*.part"))


def expect_whole_runs(folder: Path) -> None:
    """Whatever a killed training left under its name can be read to its end."""
    for path in folder.rglob("results.csv"):
        assert read_results(path)
    for path in folder.rglob("*.json"):
        json.loads(path.read_text())
    for path in folder.rglob("*.ckpt"):
        load_network(str(path))
