"""Seconds a training episode of the demo's network, under different settings of the process.

    python benchmarks/episode.py [--runs 3] [--rounds 3]

Forward, backward and optimizer step over 24 ways of 7 scans, BEVs of 120 x 120 cells with some 700
of them occupied, as in the simulated campus. Each setting needs a process of its own, since
allocator and OpenMP are set at its start. The settings take turns, `--rounds` times, so that what
else the machine does falls on all of them alike. Takes minutes. Prints medians and inter-quartile
ranges over all repeats.
"""

import argparse
import contextlib
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from deepring.cli.process import tune_process

WAYS, SCANS = 24, 7


@dataclass(frozen=True)
class Setting:
    threads: int
    keep: bool = True  # freed memory
    sleep: bool = True  # threads that wait; else as OpenMP has it by default
    busy: bool = False  # another program on one core

    def __str__(self) -> str:
        words = ["one thread" if self.threads == 1 else f"{self.threads} threads"]
        if self.threads == 1:
            words.append("freed memory kept" if self.keep else "glibc's default allocator")
        else:
            words.append("sleeping" if self.sleep else "spinning")
        return ", ".join([*words, *(["another program on one core"] if self.busy else [])])


def settings() -> list[Setting]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    every = cores or 1
    alone = [Setting(1, keep=False), Setting(1)]
    if every == 1:
        return alone
    both = [
        Setting(every, sleep=sleep, busy=busy) for busy in (False, True) for sleep in (False, True)
    ]
    return [*alone, *both]


def street(rng: np.random.Generator) -> np.ndarray:
    """Points of two facades and of poles and trunks beside them, at any yaw; (n, 3) float32."""
    along = rng.uniform(-60, 60, (2, 3000))
    gaps = np.sin(along / rng.uniform(3, 8) + rng.uniform(0, 6)) > -0.6
    walls = np.stack([along, np.array([[-12.0], [14.0]]) + rng.normal(0, 0.3, along.shape)], -1)
    trunks = rng.integers(30, 300)
    poles = rng.uniform(-45, 45, (trunks, 1, 2)) + rng.normal(0, 0.4, (trunks, 6, 2))
    points = np.concatenate([walls[gaps], poles.reshape(-1, 2)])
    yaw = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    points = points @ turn.T + rng.uniform(-4, 4, 2)
    return np.column_stack([points, np.ones(len(points))]).astype(np.float32)


def measure(runs: int) -> dict[str, object]:
    """Seconds of each of ``runs`` episodes in this process, after two that warm it up."""
    import torch

    from deepring.methods.deepring import DeepRing, DeepRingSettings
    from deepring.rasters.bev import bev_occupancy
    from deepring.training.episodes import OneShotCrossEntropy

    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    images = np.stack([bev_occupancy(street(rng)) for _ in range(WAYS * SCANS)])
    rasters = torch.from_numpy(images.astype(np.uint8))
    small = {
        "representation": {"pool": 2},
        "encoder": {"widths": [8, 16, 32], "convolutions": 1},
    }
    network = DeepRing(DeepRingSettings.from_dict(small))
    loss = OneShotCrossEntropy()
    parameters = [*network.parameters(), *loss.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=1e-3, weight_decay=1e-4)
    targets = torch.arange(WAYS).repeat_interleave(SCANS - 1)
    seconds = []
    for _ in range(2 + runs):
        start = time.perf_counter()
        optimizer.zero_grad()
        descriptors = network(rasters)
        support, query = descriptors[:WAYS].unflatten(0, (WAYS, 1)), descriptors[WAYS:]
        loss(query, support, targets, network.score).loss.backward()
        optimizer.step()
        seconds.append(time.perf_counter() - start)
    cells = int(np.median(images.sum((1, 2))))
    return {"seconds": seconds[2:], "cells": cells, "torch": torch.__version__}


def in_process_of_its_own(setting: Setting, runs: int) -> dict[str, object]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMP_", "GOMP_"))}
    environment["OMP_NUM_THREADS"] = str(setting.threads)
    flags = [*(["--keep"] if setting.keep else []), *(["--sleep"] if setting.sleep else [])]
    command = [sys.executable, __file__, "--measure", f"--runs={runs}", *flags]
    with another_program() if setting.busy else contextlib.nullcontext():
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


@contextlib.contextmanager
def another_program() -> Iterator[None]:
    """An endless loop, held on one core where the system can hold it."""
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as loop:
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(loop.pid, {max(os.sched_getaffinity(0))})
        try:
            yield
        finally:
            loop.kill()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3, help="episodes in each process")
    parser.add_argument("--rounds", type=int, default=3, help="processes of each setting")
    for flag in ("--measure", "--keep", "--sleep"):  # how it calls itself
        parser.add_argument(flag, action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.measure:
        if args.keep:
            tune_process()
        if not args.sleep:
            os.environ.pop("OMP_WAIT_POLICY", None)
        print(json.dumps(measure(args.runs)))
        return

    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    seconds: dict[Setting, list[float]] = {setting: [] for setting in settings()}
    for _ in range(args.rounds):
        for setting, values in seconds.items():
            found = in_process_of_its_own(setting, args.runs)
            values.extend(found["seconds"])
    print(
        f"{platform.processor() or platform.machine()}, {args.rounds} x {args.runs} episodes a "
        f"setting, {WAYS * SCANS} scans of {found['cells']} occupied cells, torch "
        f"{found['torch']}, load of the machine before: {load}\n"
    )
    print("| setting | median s | IQR s |\n| --- | ---: | ---: |")
    for setting, values in seconds.items():
        low, median, high = np.percentile(values, [25, 50, 75])
        print(f"| {setting} | {median:.2f} | {low:.2f} - {high:.2f} |")


if __name__ == "__main__":
    main()
