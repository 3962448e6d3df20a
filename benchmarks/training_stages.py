"""An episode of training: forward, backward and step over 24 ways of 7 scans."""

import shutil
from collections.abc import Callable, Iterator
from typing import Any

import torch
from scenes import places
from timing import Row, timed

from deepring.core.radon import radon
from deepring.methods.deepring import DeepRing, DeepRingSettings
from deepring.training.episodes import OneShotCrossEntropy

WAYS, SCANS = 24, 7

#: `method/encoder=unet_small` with `method.representation.pool=2`, and `method/encoder=unet_stem`.
SMALL = {
    "representation": {"pool": 2},
    "encoder": {"widths": [8, 16, 32], "convolutions": 1},
}
STEM = {"encoder": {"stem": 2, "widths": [16, 32, 64], "convolutions": 1}}


def episode(
    settings: dict[str, Any],
    device: str,
    *,
    channels_last: bool = False,
    bfloat16: bool = False,
    compiled: bool = False,
) -> Callable[[], object]:
    torch.manual_seed(0)
    rasters = places(WAYS * SCANS).to(device)
    network = DeepRing(DeepRingSettings.from_dict(settings)).to(device)
    if channels_last:
        network = network.to(memory_format=torch.channels_last)
    describe = torch.compile(network) if compiled else network
    loss = OneShotCrossEntropy().to(device)
    parameters = [*network.parameters(), *loss.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=1e-3, weight_decay=1e-4)
    targets = torch.arange(WAYS, device=device).repeat_interleave(SCANS - 1)

    def step() -> None:
        optimizer.zero_grad()
        with torch.autocast(device, torch.bfloat16, enabled=bfloat16):
            descriptors = describe(rasters)
            support, query = descriptors[:WAYS].unflatten(0, (WAYS, 1)), descriptors[WAYS:]
            value = loss(query, support, targets, network.score).loss
        value.backward()
        optimizer.step()
        if device != "cpu":
            torch.cuda.synchronize()

    return step


def training_stages(runs: int, device: str = "cpu") -> Iterator[Row]:
    """Both networks by memory format, the small one by precision and compiled, and sinograms."""
    few = max(3, runs // 10) if device == "cpu" else runs
    rasters = places(WAYS * SCANS).to(device)
    seconds = timed(lambda: radon(rasters, 120, 120), few)
    yield Row("training", "sinograms of an episode", WAYS * SCANS, *seconds, "episode")
    for name, settings in (("DeepRING small", SMALL), ("DeepRING with a stem", STEM)):
        for channels_last in (False, True):
            for bfloat16 in (False, True) if settings is SMALL or device != "cpu" else (False,):
                words = [
                    name,
                    *(["channels last"] if channels_last else []),
                    *(["bfloat16"] if bfloat16 else []),
                ]
                step = episode(settings, device, channels_last=channels_last, bfloat16=bfloat16)
                seconds = timed(step, few)
                yield Row("training", ", ".join(words), WAYS * SCANS, *seconds, "episode")
    if device == "cpu" and shutil.which("g++") is None:
        return  # torch.compile makes C++ for a CPU
    seconds = timed(episode(SMALL, device, compiled=True), few)
    yield Row("training", "DeepRING small, torch.compile", WAYS * SCANS, *seconds, "episode")
