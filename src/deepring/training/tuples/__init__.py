"""Training on tuples of a query, positives and negatives (PointNetVLAD, DiSCO)."""

from deepring.training.tuples.tuple_losses import LazyQuadruplet as LazyQuadruplet
from deepring.training.tuples.tuple_losses import QuadrupletWithTurn as QuadrupletWithTurn
from deepring.training.tuples.tuple_losses import TupleDescriptors as TupleDescriptors
from deepring.training.tuples.tuple_losses import TupleLoss as TupleLoss
from deepring.training.tuples.tuple_losses import TurnCrossEntropy as TurnCrossEntropy
from deepring.training.tuples.tuple_scheme import TupleBatch as TupleBatch
from deepring.training.tuples.tuple_scheme import TupleScheme as TupleScheme
from deepring.training.tuples.tuple_scheme import TupleSet as TupleSet
