"""Training on points that two scans share, for local descriptors and for keypoints (DH3D)."""

from deepring.training.correspondences.correspondence_losses import (
    CorrespondenceLoss as CorrespondenceLoss,
)
from deepring.training.correspondences.correspondence_losses import (
    Correspondences as Correspondences,
)
from deepring.training.correspondences.correspondence_losses import NTuple as NTuple
from deepring.training.correspondences.correspondence_losses import Reliability as Reliability
from deepring.training.correspondences.correspondence_scheme import (
    CorrespondenceBatch as CorrespondenceBatch,
)
from deepring.training.correspondences.correspondence_scheme import (
    CorrespondenceScheme as CorrespondenceScheme,
)
from deepring.training.correspondences.correspondence_scheme import (
    CorrespondenceSet as CorrespondenceSet,
)
