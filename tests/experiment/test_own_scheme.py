"""The training scheme of docs/extending.md, as its reader would write it."""

import re
import shutil
from functools import partial

import pytest
import torch
from hydra import compose, initialize_config_dir

from deepring.errors import ConfigError
from deepring.experiment.config import check_config
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.experiment.train import train
from helpers.pages import blocks_of
from helpers.small_training import TINY_DATA


@pytest.fixture
def trained(tiny_nclt, tmp_path, monkeypatch):
    """A function that trains with the page's file and configs in a run folder of that name."""
    blocks = blocks_of("extending.md", "A training scheme")
    (code,) = (block.text for block in blocks if block.language == "python")
    (tmp_path / "partners.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    conf = shutil.copytree(config_folder(), tmp_path / "conf")
    for config in (block.text for block in blocks if block.language == "yaml"):
        path = re.match(r"# conf/(\S+)", config)[1]
        (conf / path).write_text(config.replace("deepring.training.partners", "partners"))
    register_configs()
    monkeypatch.setattr("sys.dont_write_bytecode", True)

    def run(name, epochs, *overrides):
        folder = tmp_path / name
        with initialize_config_dir(str(conf), version_base="1.3"):
            composed = compose(
                "train",
                [
                    *("sampling=partners", "loss=info_nce", "sampling.pairs=4"),
                    *(
                        "sampling.per_epoch=3",
                        "method/encoder=unet_small",
                        f"data.root={tiny_nclt}",
                    ),
                    *(*TINY_DATA, f"paths.outputs={tmp_path}", f"paths.run={folder}"),
                    *(f"trainer.max_epochs={epochs}", "trainer.log_every_n_steps=1"),
                    *("callbacks.progress=null", "evaluate=false", *overrides),
                ],
            )
        return train(check_config(composed), folder)

    return run


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists")
def test_the_docs_scheme_trains_from_its_file_and_its_configs_and_resumes(trained, tmp_path):
    last = partial(torch.load, weights_only=True)
    whole = last(trained("whole", 2).folder / "checkpoints" / "last.ckpt")
    stopped = trained("stopped", 1).folder / "checkpoints" / "last.ckpt"
    assert whole["hyper_parameters"]["loss"] == "InfoNce"
    before = last(stopped)["state_dict"]
    resumed = last(trained("stopped", 2, f"resume={stopped}").folder / "checkpoints" / "last.ckpt")
    weights = whole["state_dict"]
    assert all(torch.equal(weights[key], resumed["state_dict"][key]) for key in weights)
    assert not all(torch.equal(weights[key], before[key]) for key in weights)


def test_the_docs_scheme_refuses_losses_and_keys_of_others(trained):
    with pytest.raises(ConfigError, match=r"loss: OneShotCrossEntropy, expected .* InfoNce"):
        trained("run", 1, "loss=cross_entropy")
    with pytest.raises(ConfigError, match=r"sampling\.pairs: 1, expected"):
        trained("run", 1, "sampling.pairs=1")
    with pytest.raises(ConfigError, match=r"sampling\.ways: unknown, expected one of pairs"):
        trained("run", 1, "+sampling.ways=3")
