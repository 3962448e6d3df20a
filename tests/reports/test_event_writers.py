"""Writers of TensorBoard events close soon, even where Ctrl-C came at the worst moment."""

import time
from collections import deque
from functools import partial

import pytest
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from omegaconf import OmegaConf
from torch.utils.tensorboard import SummaryWriter

from deepring.experiment.config_groups import config_folder
from deepring.reports import tensorboard_events


class Interrupting(deque):
    """Waiters of a condition; the first `remove` meets Ctrl-C, after its waiter was released."""

    met = False

    def remove(self, waiter):
        if not self.met:
            self.met = True
            time.sleep(0.1)  # the waiter wakes up meanwhile
            raise KeyboardInterrupt
        super().remove(waiter)


def interrupt(writer, note):
    """Log a number, with Ctrl-C between waking the writer's thread and noting that it woke."""
    note(0.0)
    time.sleep(0.1)  # the thread has written it and waits
    condition = writer.file_writer.event_writer._async_writer._byte_queue.not_empty
    condition._waiters = Interrupting(condition._waiters)
    with pytest.raises(KeyboardInterrupt):
        note(1.0)
    time.sleep(0.1)
    assert condition._waiters.met


def seconds(action):
    start = time.monotonic()
    action()
    return time.monotonic() - start


def test_the_logger_of_a_training_closes_soon_after_ctrl_c(tmp_path):
    config = OmegaConf.to_container(OmegaConf.load(config_folder() / "logger/tensorboard.yaml"))
    values = {key: value for key, value in config.items() if key != "_target_"}
    logger = TensorBoardLogger(**{**values, "save_dir": str(tmp_path)})
    interrupt(logger.experiment, lambda x: logger.log_metrics({"loss": x}))
    assert seconds(lambda: logger.finalize("failed")) < 20  # 120 as TensorBoard has it


def test_the_writer_of_an_evaluation_closes_soon_after_ctrl_c(tmp_path, monkeypatch):
    seen = []

    class Interrupted(SummaryWriter):
        def add_embedding(self, *_, **__):
            seen.append(self)
            interrupt(self, lambda x: self.add_scalar("x", x))

    monkeypatch.setattr(tensorboard_events, "SummaryWriter", Interrupted)
    points = tensorboard_events.Projection(torch.zeros(2, 3), ["scan"], [["a"], ["b"]], None)
    add = partial(tensorboard_events.add_projection, tmp_path, "x", points)
    assert seconds(add) < 20
    assert seen
