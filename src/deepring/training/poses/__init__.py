"""Training on pairs of scans whose relative pose is known (LCDNet)."""

from deepring.training.poses.pose_losses import PoseLoss as PoseLoss
from deepring.training.poses.pose_losses import PosePairs as PosePairs
from deepring.training.poses.pose_losses import TripletWithPose as TripletWithPose
from deepring.training.poses.pose_scheme import PoseBatch as PoseBatch
from deepring.training.poses.pose_scheme import PoseNetwork as PoseNetwork
from deepring.training.poses.pose_scheme import PoseScheme as PoseScheme
from deepring.training.poses.pose_scheme import PoseSet as PoseSet
