"""Training on segments by what they are segments of (Locus, with SegMap's network)."""

from deepring.training.segments.segment_losses import SegmentIdentity as SegmentIdentity
from deepring.training.segments.segment_losses import SegmentLoss as SegmentLoss
from deepring.training.segments.segment_scheme import SegmentBatch as SegmentBatch
from deepring.training.segments.segment_scheme import SegmentDescriber as SegmentDescriber
from deepring.training.segments.segment_scheme import SegmentScheme as SegmentScheme
from deepring.training.segments.segment_scheme import SegmentSet as SegmentSet
