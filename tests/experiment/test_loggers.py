"""Where the figures of a training go: other loggers than TensorBoard's."""

import csv
import re
import sys
from dataclasses import replace

import pytest
import yaml
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger

from deepring.errors import ConfigError
from deepring.evaluation.case import Case
from deepring.experiment import build
from deepring.experiment.loggers import add_results, begin, make_logger
from helpers.results import result_of

RING = Case(method="RING", train="", test="nclt", region="test")


def test_csv_has_hyperparameters_and_the_figures_of_the_first_radius(tmp_path):
    logger = CSVLogger(tmp_path, name="csv", version="")
    begin([logger], {"seed": 3, "loss": "CE"})
    logger.log_metrics({"train/loss": 1.0}, step=0)
    add_results([logger], [result_of(RING, 10.0), result_of(RING, 20.0)])
    assert yaml.safe_load((tmp_path / "csv/hparams.yaml").read_text()) == {"seed": 3, "loss": "CE"}
    with (tmp_path / "csv/metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    named = {name: value for row in rows for name, value in row.items() if value}
    assert float(named["test/nclt/test/recall_1/RING"]) == 0.5
    assert sum(name.startswith("test/") for name in named) == 6


def test_no_two_figures_have_one_name_in_letters_digits_and_slashes(tmp_path):
    logger = CSVLogger(tmp_path, name="csv", version="")
    add_results([logger], [result_of(RING, 10.0), result_of(replace(RING, method="RING++"), 10.0)])
    names = (tmp_path / "csv/metrics.csv").read_text().splitlines()[0].split(",")
    assert len({re.sub("[^a-zA-Z0-9_/. -]+", "", name) for name in names}) == len(names) == 13


def test_tensorboard_gets_them_with_the_evaluation(tmp_path):
    logger = TensorBoardLogger(tmp_path)
    begin([logger], {"seed": 3})
    add_results([logger], [result_of(RING, 10.0)])
    assert not list(tmp_path.rglob("events*"))


@pytest.mark.parametrize("name", ["tensorboard", "csv"])
def test_options_write_into_the_folder_of_the_run(name, composed, tmp_path):
    cfg = composed("data.root=/nowhere", f"paths.run={tmp_path}", f"logger={name}")
    trainer = build.trainer(cfg, tmp_path, validation=("nclt",))
    assert trainer.logger.log_dir.rstrip("/") == str(tmp_path / name)


@pytest.mark.parametrize(("name", "package"), [("wandb", "wandb"), ("mlflow", "mlflow")])
def test_a_package_that_is_lacking_is_named(name, package, composed, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    cfg = composed("data.root=/nowhere", f"paths.run={tmp_path}", f"logger={name}")
    with pytest.raises(ConfigError, match=rf"^logger: {package} is not installed.*\[{package}\]"):
        build.trainer(cfg, tmp_path, validation=("nclt",))


def test_what_is_no_logger_is_refused(composed):
    assert make_logger(None) is False
    with pytest.raises(ConfigError, match=r"^logger: a Adam"):
        make_logger({"_target_": f"{__name__}.Adam"})


class Adam:
    pass


class Unreachable(CSVLogger):
    def log_hyperparams(self, params):
        raise RuntimeError(f"a library's own words on {params}")


def test_a_logger_that_cannot_begin_is_refused_before_the_training(tmp_path):
    with pytest.raises(ConfigError, match=r"^logger: Unreachable cannot begin a run") as refused:
        begin([Unreachable(tmp_path)], {"seed": 3})
    assert "own words" not in str(refused.value)
