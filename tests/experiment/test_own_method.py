"""The method of docs/extending.md, as its reader would write it."""

import shutil
import sys

import pytest
from hydra import compose, initialize_config_dir

from deepring.errors import FileError
from deepring.experiment.config import check_config
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.experiment.train import train
from deepring.methods.network_file import load_network
from helpers.pages import blocks_of
from helpers.small_training import TINY_DATA


def test_the_docs_method_trains_from_its_file_and_its_config(tiny_nclt, tmp_path, monkeypatch):
    code, config = (
        blocks_of("extending.md", "A method that learns", kind)[0].text
        for kind in ("python", "yaml")
    )
    (tmp_path / "mine.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    conf = shutil.copytree(config_folder(), tmp_path / "conf")
    (conf / "method" / "mine.yaml").write_text(config.replace("deepring.methods.mine", "mine"))
    register_configs()
    with initialize_config_dir(str(conf), version_base="1.3"):
        composed = compose(
            "train",
            [
                *("method=mine", "sampling.size=4", "sampling.limit=4", "sampling.per_epoch=2"),
                *(f"data.root={tiny_nclt}", *TINY_DATA, f"paths.outputs={tmp_path}"),
                *(f"paths.run={tmp_path / 'run'}", "evaluation.figures=false"),
                *("trainer.max_epochs=1", "trainer.log_every_n_steps=1", "callbacks.progress=null"),
            ],
        )
    trained = train(check_config(composed), tmp_path / "run")
    own_class = sys.modules["mine"].Mine
    assert type(load_network(trained.checkpoint, own_class).method) is own_class
    with pytest.raises(FileError, match=r"'mine\.Mine' is not registered"):
        load_network(trained.checkpoint)
    assert "Mine" in {r.case.method for r in trained.results}
