"""Training on pairs of scans: of one place or two (LocNet, RINet), by overlap (OverlapNet)."""

from deepring.training.pairs.overlap_loss import OverlapAndTurn as OverlapAndTurn
from deepring.training.pairs.overlap_loss import OverlapHeads as OverlapHeads
from deepring.training.pairs.overlap_loss import OverlapPairs as OverlapPairs
from deepring.training.pairs.overlap_scheme import OverlapBatch as OverlapBatch
from deepring.training.pairs.overlap_scheme import OverlapScheme as OverlapScheme
from deepring.training.pairs.overlap_scheme import OverlapSet as OverlapSet
from deepring.training.pairs.pair_losses import Contrastive as Contrastive
from deepring.training.pairs.pair_losses import PairDescriptors as PairDescriptors
from deepring.training.pairs.pair_losses import PairHead as PairHead
from deepring.training.pairs.pair_losses import PairLoss as PairLoss
from deepring.training.pairs.pair_losses import SoftMatch as SoftMatch
from deepring.training.pairs.pair_scheme import PairBatch as PairBatch
from deepring.training.pairs.pair_scheme import PairScheme as PairScheme
from deepring.training.pairs.pair_scheme import PairSet as PairSet
