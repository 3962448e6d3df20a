"""One training step: a batch through the method and its loss. One function a kind of batch."""

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from deepring.methods.network import NetworkMethod
from deepring.training.episodes import Episode
from deepring.training.losses import OneShotCrossEntropy
from deepring.training.scan_batches import ScanBatch
from deepring.training.tuple_losses import QuadrupletWithYaw
from deepring.training.tuples import TupleBatch


class Step(NamedTuple):
    """What a batch gives."""

    loss: Tensor
    """Scalar, to be minimised."""
    accuracy: Tensor
    """Share of queries that find their own place in the batch."""
    parts: dict[str, Tensor]
    """What else is worth a curve, detached."""


def take_step(method: NetworkMethod, loss: nn.Module, batch: Any) -> Step:
    """The loss of an `Episode`, a `TupleBatch` or a `ScanBatch`."""
    match batch:
        case Episode():
            return episode_step(method, loss, batch)
        case TupleBatch():
            return tuple_step(method, loss, batch)
        case ScanBatch():
            return scan_step(method, loss, batch)
    raise TypeError(f"batch: {type(batch).__name__}")


def episode_step(method: NetworkMethod, loss: nn.Module, episode: Episode) -> Step:
    """Compare each query of the episode with its ways, by the method's own similarity."""
    ways, shots = episode.support.shape[:2]
    queries = episode.query.shape[1]
    rasters = torch.cat([episode.support.flatten(0, 1), episode.query.flatten(0, 1)])
    descriptors = method(rasters)
    support, query = descriptors[: ways * shots], descriptors[ways * shots :]
    targets = torch.arange(ways, device=query.device).repeat_interleave(queries)
    value = loss(query, support.unflatten(0, (ways, shots)), targets, method.score)
    accuracy = (value.scores.argmax(dim=-1) == targets).float().mean()
    parts = {}
    if isinstance(loss, OneShotCrossEntropy):
        parts["W"] = loss.classifier.weight.detach()
    return Step(value.loss, accuracy, parts)


def tuple_step(method: NetworkMethod, loss: nn.Module, batch: TupleBatch) -> Step:
    """Distances within each tuple, and for DiSCO the query's turn."""
    shape = batch.rasters.shape[:2]
    descriptors = method(batch.rasters.flatten(0, 1))
    vectors = method.vectors(descriptors).view(*shape, -1)
    if isinstance(loss, QuadrupletWithYaw):
        maps = descriptors.view(*shape, *descriptors.shape[1:])
        return Step(*loss(vectors, maps, batch.positives, batch.turn))
    return Step(*loss(vectors, batch.positives))


def scan_step(method: NetworkMethod, loss: nn.Module, batch: ScanBatch) -> Step:
    """Distances between all scans of the batch."""
    vectors = method.vectors(method(batch.rasters))
    return Step(*loss(vectors, batch.same, batch.different))
