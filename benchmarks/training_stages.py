"""An episode of training: forward, backward and step over 24 ways of 7 scans."""

from collections.abc import Callable, Iterator

import torch
from scenes import places
from timing import Row, timed

from deepring.methods.deepring import DeepRing, DeepRingSettings
from deepring.training.losses import OneShotCrossEntropy

WAYS, SCANS = 24, 7

SMALL = {"pool": 2, "widths": [8, 16, 32], "convolutions": 1}


def episode(device: str, *, channels_last: bool, bfloat16: bool) -> Callable[[], object]:
    torch.manual_seed(0)
    rasters = places(WAYS * SCANS).to(device)
    network = DeepRing(DeepRingSettings(**SMALL)).to(device)
    if channels_last:
        network = network.to(memory_format=torch.channels_last)
    loss = OneShotCrossEntropy().to(device)
    parameters = [*network.parameters(), *loss.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=1e-3, weight_decay=1e-4)
    targets = torch.arange(WAYS, device=device).repeat_interleave(SCANS - 1)

    def step() -> None:
        optimizer.zero_grad()
        with torch.autocast(device, torch.bfloat16, enabled=bfloat16):
            descriptors = network(rasters)
            support, query = descriptors[:WAYS].unflatten(0, (WAYS, 1)), descriptors[WAYS:]
            value = loss(query, support, targets, network.score).loss
        value.backward()
        optimizer.step()
        if device != "cpu":
            torch.cuda.synchronize()

    return step


def training_stages(runs: int, device: str = "cpu") -> Iterator[Row]:
    """The small network, by memory format and precision."""
    few = max(3, runs // 10) if device == "cpu" else runs
    for channels_last in (False, True):
        for bfloat16 in (False, True):
            words = [
                "DeepRING small",
                *(["channels last"] if channels_last else []),
                *(["bfloat16"] if bfloat16 else []),
            ]
            step = episode(device, channels_last=channels_last, bfloat16=bfloat16)
            seconds = timed(step, few)
            yield Row("training", ", ".join(words), WAYS * SCANS, *seconds, "episode")
