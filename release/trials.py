"""What is tried in an environment: the commands of a first day, and what each extra is for."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

from release.environment import Environment
from release.requirements import ROOT

_SCRIPTS = Path(__file__).parent / "scripts"

_TOWN = [
    *("block=45", "train_columns=2", "test_columns=2", "rows=2", "scan_spacing=3"),
    *("azimuths=200",),
]

#: A training of some seconds on one half of the town.
_TRAINING = [
    *("train", "method=deepring_small", "data=sim_custom", "data.root=town/drive.yaml"),
    *("method/similarity=l2", "methods={}", "evaluation.rerank=[]", "trainer.max_epochs=1"),
    *("sampling.ways=2", "sampling.queries=1", "sampling.per_epoch=4", "data.spacing.train=1"),
    *("data.regions.validation_share=0.3", "data.regions.margin=1", "data.spacing.database=20"),
    *("trainer.log_every_n_steps=1",),
]

Trial = Callable[[Environment], None]


def smoke(environment: Environment) -> None:
    """Simulate, check, build a map, locate, train and evaluate; what is trusted is right."""
    deepring = environment.deepring
    deepring("--version")
    deepring("simulate", "custom", "-o", "town", *_TOWN)
    deepring("data", "check", "town/drive.yaml")
    deepring("map", "build", "town/drive.yaml", "--session", "map", "-o", "town.map", "--points")
    query = ["town.map", "town/drive.yaml", "--session", "query"]
    found = deepring("localize", *query, "--every", "25", "--as", "json")
    (environment.work / "located.json").write_text(found, encoding="utf-8")
    environment.run(str(_SCRIPTS / "locations.py"))
    deepring(*_TRAINING)
    deepring("doctor")  # fails if a package is older than the lowest version


def _bags(environment: Environment) -> None:
    page = (ROOT / "docs" / "tutorials" / "own_bag.md").read_text(encoding="utf-8")
    (script,) = re.findall(r'```python title="make_bag.py"\n(.*?)```', page, re.DOTALL)
    file = environment.work / "make_bag.py"
    file.write_text(script.replace("lane/drive.yaml", "town/drive.yaml"), encoding="utf-8")
    environment.run("make_bag.py")
    environment.deepring("localize", "town.map", "lane_bag", "--every", "60")


def _odometry(environment: Environment) -> None:
    few = environment.work / "few"
    few.mkdir()
    for file in sorted((environment.work / "town" / "map" / "scans").iterdir())[:12]:
        shutil.copy(file, few)
    environment.deepring("loops", "few", "-o", "few_found")


def _las(environment: Environment) -> None:
    environment.run(str(_SCRIPTS / "cloud.py"))
    environment.deepring("map", "build", "city.laz", "--path", "city.tum", "-o", "city.map")


def _command(*words: str) -> Trial:
    def trial(environment: Environment) -> None:
        environment.deepring(*words)

    return trial


def _parallel(environment: Environment) -> None:
    for launcher in ("joblib", "submitit_local"):
        environment.deepring(
            *_TRAINING, "-m", "seed=0", f"hydra/launcher={launcher}", f"sweep_name={launcher}"
        )


def _in_checkout(*words: str) -> Trial:
    def trial(environment: Environment) -> None:
        environment.run(*words, cwd=ROOT)

    return trial


def _docs(environment: Environment) -> None:
    site = str(environment.work / "site")
    environment.run(
        *("-m", "mkdocs", "build", "--quiet", "--strict", "-d", site),
        cwd=ROOT,
        variables={"NO_MKDOCS_2_WARNING": "1"},
    )


def _dev(environment: Environment) -> None:
    environment.run("-m", "ruff", "check", "--no-cache", ".", cwd=ROOT)
    environment.run(
        *("-m", "pytest", "-p", "no:cacheprovider", "tests/core/test_similarity.py"), cwd=ROOT
    )


def suite(environment: Environment) -> None:
    """The tests of the checkout, as `make test` runs them."""
    environment.run(
        *("-m", "pytest", "-p", "no:cacheprovider", "-n", "2", "--dist", "worksteal"), cwd=ROOT
    )


#: Of each extra of pyproject.toml, after the smoke test in the same folder.
TRIALS: dict[str, Trial] = {
    "parallel": _parallel,
    "search": _command(*_TRAINING, "-m", "sweep=optuna", "hydra.sweeper.n_trials=2"),
    "bags": _bags,
    "refine": _command(
        *("localize", "town.map", "town/drive.yaml", "--session", "query"),
        *("--every", "60", "--refine"),
    ),
    "odometry": _odometry,
    "optimize": _command(
        *("loops", "town/drive.yaml", "--session", "map", "--spacing", "12"),
        *("--optimize", "-o", "town_found"),
    ),
    "las": _las,
    "view": _command("map", "info", "town.map", "--view-file", "town.rrd"),
    "onnx": _command("export", "shipped", "-o", "network.onnx"),
    "wandb": _command(*_TRAINING, "logger=wandb", "logger.offline=true"),
    "mlflow": _command(*_TRAINING, "logger=mlflow"),
    "peers": _in_checkout("benchmarks/peers.py", "--help"),
    "docs": _docs,
    "mutation": _in_checkout("-m", "mutmut", "--version"),
    "dev": _dev,
}
