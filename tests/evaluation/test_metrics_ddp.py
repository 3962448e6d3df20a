"""Two processes (gloo) give what one gives, also where their shares differ or one has none."""

import os

import pytest
import torch
import torch.distributed as dist
import torch.multiprocessing as mp
from torchmetrics import MetricCollection

from deepring.evaluation.batched_metrics import MaxF1, PlaceAUC, PlacePrecisionRecall, RecallAtK

QUERIES, PLACES, RADIUS = 41, 23, 10.0
SHARES = {"even": (21, 20), "uneven": (35, 6), "one has none": (41, 0)}


def everything():
    generator = torch.Generator().manual_seed(3)
    # few distinct scores: ties across the processes; about one query in ten unanswerable
    scores = torch.randint(-4, 9, (QUERIES, PLACES), generator=generator).double() / 4
    return scores, torch.rand(QUERIES, PLACES, generator=generator) * 100


def all_metrics():
    single = {"recall@1": RecallAtK(1, RADIUS), "recall@5/all": RecallAtK(5, 25.0, over="all")}
    metrics = {**single, "f1": MaxF1(RADIUS), "auc": PlaceAUC(RADIUS)}
    return MetricCollection(metrics, compute_groups=False), PlacePrecisionRecall(RADIUS)


def measure(scores, distances, batch=4):
    collection, curve = all_metrics()
    for start in range(0, len(scores), batch):
        part = scores[start : start + batch], distances[start : start + batch]
        collection.update(*part)
        curve.update(*part)
    return {**collection.compute(), **dict(zip("prt", curve.compute(), strict=True))}


def work(rank, folder):
    # a process without queries never updates, of which torchmetrics warns
    os.environ["PYTHONWARNINGS"] = "ignore"
    torch.set_num_threads(1)
    dist.init_process_group(
        "gloo", init_method=f"file://{folder}/rendezvous", rank=rank, world_size=2
    )
    scores, distances = everything()
    for name, (first, _) in SHARES.items():
        mine = slice(None, first) if rank == 0 else slice(first, None)
        torch.save(measure(scores[mine], distances[mine]), f"{folder}/{name}-{rank}.pt")
    dist.barrier()
    # Destroying the group may hang with torch 2.4 to 2.7, where its thread frees what was gathered.
    os._exit(0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ddp")
    mp.spawn(work, args=(str(folder),), nprocs=2)
    return folder


@pytest.mark.parametrize("name", SHARES)
def test_two_processes_equal_one(folder, name):
    expected = measure(*everything())
    for rank in range(2):
        found = torch.load(folder / f"{name}-{rank}.pt", weights_only=True)
        assert found.keys() == expected.keys()
        for key, value in expected.items():
            torch.testing.assert_close(found[key], value)
