"""Training on pairs of scans that are of one place, or not (LocNet, RINet)."""

from deepring.training.pairs.pair_losses import Contrastive as Contrastive
from deepring.training.pairs.pair_losses import PairDescriptors as PairDescriptors
from deepring.training.pairs.pair_losses import PairHead as PairHead
from deepring.training.pairs.pair_losses import PairLoss as PairLoss
from deepring.training.pairs.pair_losses import SoftMatch as SoftMatch
from deepring.training.pairs.pair_scheme import PairBatch as PairBatch
from deepring.training.pairs.pair_scheme import PairScheme as PairScheme
from deepring.training.pairs.pair_scheme import PairSet as PairSet
