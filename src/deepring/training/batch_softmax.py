"""Cross-entropy over a batch of scans: each pair of one place against all other places.

Source: van den Oord et al., "Representation Learning with Contrastive Predictive Coding", 2018,
Eq. 4; over several positives as in Khosla et al., "Supervised Contrastive Learning", 2020, Eq. 2.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from deepring import checks
from deepring.methods.network import NetworkMethod
from deepring.training.batch_hard import ScanBatch, ScanBatchLoss
from deepring.training.scheme import Step
from deepring.training.triplets import batch_accuracy, squared_distances
from deepring.training.tuples import TurnCrossEntropy


class BatchSoftmax(ScanBatchLoss):
    """-log(e^s(a,p) / (e^s(a,p) + Σ_n e^s(a,n))), the mean over all pairs a, p of one place.

    s is minus half the squared Euclidean distance over ``temperature``: for descriptors of unit
    norm the cosine, but for a constant. Every scan is a query and all others of the batch are its
    candidates; the nearest negatives weigh most, and all weigh something, so that, unlike with the
    hardest triplets, the descriptors do not collapse.

    Args:
        temperature: of the softmax; a smaller one looks at the nearest scans alone
    """

    def __init__(self, temperature: float = 0.05) -> None:
        super().__init__()
        self.temperature = checks.positive("loss.temperature", temperature)

    def forward(self, vectors: Tensor, positives: Tensor, negatives: Tensor) -> Step:
        """See `ScanBatchLoss`. Scans without a positive or a negative do not count."""
        distance = squared_distances(vectors)
        logits = -distance / (2 * self.temperature)
        usable = positives & negatives.any(dim=1, keepdim=True)
        # A finite stand-in for the logits of no negative: the gradient of -inf is not a number.
        least = torch.finfo(logits.dtype).min
        others = logits.masked_fill(~negatives, least).logsumexp(dim=1, keepdim=True)
        pairs = F.softplus(others - logits)[usable]
        loss = pairs.sum() / max(len(pairs), 1)
        return Step(loss, batch_accuracy(distance, positives, negatives), {})


class BatchSoftmaxWithTurn(BatchSoftmax):
    """`BatchSoftmax` of the signatures, and the cross-entropy of the turn of each pair (DiSCO).

    The turn is sought as in `TurnCrossEntropy`, between each scan and the first of its place in
    the batch, and weighs ``turn_weight`` times its mean over the scans.

    Args:
        temperature: as in `BatchSoftmax`
        turn_scale: factor of the correlation before the softmax over turns
        turn_weight: weight of the turn's cross-entropy
    """

    def __init__(
        self, temperature: float = 0.05, turn_scale: float = 10.0, turn_weight: float = 0.2
    ) -> None:
        super().__init__(temperature)
        self.turn = TurnCrossEntropy(turn_scale)
        self.turn_weight = checks.positive("loss.turn_weight", turn_weight)

    def of_batch(self, vectors: Tensor, descriptors: Tensor, batch: ScanBatch) -> Step:
        """See `ScanBatchLoss`; descriptors are feature maps (b, θ, r), ``parts`` has the terms."""
        step = self(vectors, batch.positives, batch.negatives)
        scans = batch.positives.any(dim=1).nonzero()[:, 0]
        partners = batch.positives[scans].int().argmax(dim=1)
        between = batch.orientations[scans] - batch.orientations[partners]
        turn = between.round().long() % descriptors.shape[-2]
        total = self.turn(descriptors[scans], descriptors[partners][:, None], turn)
        mean = total / max(len(scans), 1)
        parts = {"softmax": step.loss.detach(), "turn": mean.detach()}
        return Step(step.loss + self.turn_weight * mean, step.accuracy, parts)

    def expect(self, method: NetworkMethod, *, turned: bool) -> None:
        """See `TurnCrossEntropy.expect`."""
        self.turn.expect(method, turned=turned)
