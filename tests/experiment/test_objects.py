"""The values of optimizers, schedules, callbacks and the trainer: refused by name, before work."""

from typing import Literal

import pytest
import torch

from deepring.errors import ConfigError
from deepring.experiment import build
from deepring.experiment.objects import make
from deepring.experiment.plain_types import fits, in_words
from deepring.experiment.trainer_values import check_trainer

TRAINER = {"accelerator": "cpu", "devices": 1, "num_nodes": 1, "precision": "32-true"}

WRONG = [
    ("optimizer.lr=-1", r"optimizer\.lr: -1, expected a number of at least 0"),
    ("optimizer.lr=abc", r"optimizer\.lr: 'abc', expected a number"),
    ("optimizer.lr=nan", r"optimizer\.lr: nan, expected a finite number"),
    ("optimizer.weight_decay=-1", r"optimizer\.weight_decay: -1, expected a number of at least 0"),
    ("+optimizer.foo=1", r"optimizer\.foo: unknown to .*Adam, expected one of lr, betas"),
    ("+optimizer.betas=[1,2]", r"optimizer\.betas: \[1, 2\], expected a value that .*Adam takes"),
    ("+optimizer.amsgrad=3", r"optimizer\.amsgrad: 3, expected true or false"),
    ("optimizer=null", r"optimizer: null, expected values by name"),
    ("optimizer._target_=torch.optim.Nope", r"optimizer\._target_: 'torch\.optim\.Nope' cannot"),
    ("optimizer._target_=nope", r"optimizer\._target_: 'nope' cannot be imported; expected"),
    ("optimizer={_target_: builtins.dict}", r"optimizer: builtins.dict takes no such values"),
    ("scheduler.milestones=3", r"scheduler\.milestones: 3, expected a list"),
    ("scheduler.milestones=[a]", r"scheduler\.milestones: \['a'\], expected a list"),
    ("scheduler.gamma=-1", r"scheduler\.gamma: -1, expected a number above 0"),
    ("scheduler.gamma=x", r"scheduler\.gamma: 'x', expected a number"),
    ("loss.temperature_scale=0", r"loss\.temperature_scale: 0, expected a number above 0"),
    ("+loss.foo=1", r"loss\.foo: unknown to .*, expected one of temperature_scale"),
    ("sampling.ways=many", r"sampling\.ways: 'many', expected a whole number"),
    ("trainer.max_epochs=-5", r"trainer\.max_epochs: -5, expected a whole number of at least 1"),
    ("trainer.accelerator=gpuu", r"trainer\.accelerator: 'gpuu', expected one of auto, cpu"),
    ("callbacks.last=3", r"callbacks\.last: 3, expected values by name"),
    ("trainer=null", r"trainer: null, expected values by name"),
]


@pytest.mark.parametrize(("override", "said"), WRONG)
def test_a_wrong_value_is_named_even_where_nothing_is_trained(composed, override, said):
    cfg = composed("data.root=/nowhere", override)
    with pytest.raises(ConfigError, match=said) as refusal:
        build.check_training(cfg)
    assert "\n" not in str(refusal.value)


def test_the_config_s_own_values_pass(composed):
    for scheduler in ("multistep", "step", "constant"):
        build.check_training(composed("data.root=/nowhere", f"scheduler={scheduler}"))


@pytest.mark.parametrize(
    ("key", "wrong", "right"),
    [
        ("max_epochs", (0, -2, 1.5, True, "x"), (1, -1, None)),
        ("max_steps", (0, -2, 1.5), (10, -1)),
        ("accelerator", ("gpuu", 3, None), ("cpu", "auto")),
        ("devices", (0, -3, "x", [7], [], 1.5, True), (1, 2, "auto", -1)),
        ("num_nodes", (0, -1, 1.5), (1, 2)),
        ("check_val_every_n_epoch", (0, -1, 0.5), (1, None)),
        ("log_every_n_steps", (-1, 0.5), (0, 10)),
        ("num_sanity_val_steps", (-2, "x"), (-1, 0)),
        ("gradient_clip_val", (-1, "x", float("nan")), (0, 0.5, None)),
        ("fast_dev_run", (-1, "x"), (True, False, 2)),
        ("max_time", ("x", 3, "1:2"), ("00:12:00:00", None, {"hours": 1})),
        ("precision", ("64", 16, None), ("32", 32, "bf16-mixed")),
    ],
)
def test_a_trainer_s_values_are_checked(key, wrong, right):
    for value in wrong:
        with pytest.raises(ConfigError, match=rf"^trainer\.{key}: "):
            check_trainer({**TRAINER, key: value})
    for value in right:
        check_trainer({**TRAINER, key: value})


def test_a_callback_waits_for_a_value_that_is_logged(composed, tmp_path):
    def trainer(*overrides, validation=("nclt",)):
        cfg = composed("data.root=/nowhere", f"paths.run={tmp_path}", "~logger", *overrides)
        return build.trainer(cfg, tmp_path, validation=validation)

    said = r"callbacks\.checkpoint\.monitor: 'nope', expected one of val/recall@1, val/nclt/recall"
    with pytest.raises(ConfigError, match=said):
        trainer("callbacks.checkpoint.monitor=nope")
    trainer("callbacks.checkpoint.monitor=val/nclt/auc")
    trainer("callbacks.checkpoint.monitor=train/loss")
    trainer(validation=())


class Taker:
    def __init__(self, number: float, *, word: str = "a", choice: Literal["a", "b"] = "a") -> None:
        if number > 9:
            raise ValueError("a library's own words")
        self.number, self.word, self.choice = number, word, choice


def test_the_value_that_a_target_refuses_is_found():
    node = {"_target_": f"{__name__}.Taker", "word": "x"}
    assert make({**node, "number": 3}, "taker").number == 3
    with pytest.raises(ConfigError, match=r"^taker\.number: no value"):
        make(node, "taker")
    with pytest.raises(ConfigError, match=r"^taker\.number: '3', expected a number"):
        make({**node, "number": "3"}, "taker")
    with pytest.raises(ConfigError, match=r"^taker\.choice: 'c', expected a or b"):
        make({**node, "number": 3, "choice": "c"}, "taker")
    with pytest.raises(ConfigError, match=r"^taker\.word: is set by deepring itself"):
        make({**node, "number": 3}, "taker", word="y")
    with pytest.raises(ConfigError, match=r"takes no such values together: word 'x', number 10"):
        make({**node, "number": 10}, "taker")


@pytest.mark.parametrize(
    ("hint", "value", "right"),
    [
        (int, 3, True),
        (int, True, False),
        (int, 3.0, False),
        (float, 3, True),
        (float, "3", False),
        (float | None, None, True),
        (float | torch.Tensor, "3", False),
        (torch.Tensor, "3", True),  # no plain type: the target decides
        (list[int], [1, 2], True),
        (list[int], [1, "a"], False),
        (tuple[float, ...], [0.5], True),
        (dict[str, int], {"a": 1}, True),
        (Literal["a", 1], True, False),
        (Literal["a", 1], 1, True),
        (bool, {"_target_": "x"}, True),
    ],
)
def test_plain_values_fit_types(hint, value, right):
    assert fits(hint, value) is right
    assert right or in_words(hint)
