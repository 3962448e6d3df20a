"""Training of DeepRING on episodes of N ways, a few shots and queries (paper, Sec. IV)."""

from deepring.training.episodes.episode_losses import EpisodeLoss as EpisodeLoss
from deepring.training.episodes.episode_losses import OneShotClassifier as OneShotClassifier
from deepring.training.episodes.episode_losses import OneShotCrossEntropy as OneShotCrossEntropy
from deepring.training.episodes.episode_losses import Quadruplet as Quadruplet
from deepring.training.episodes.episode_losses import Triplet as Triplet
from deepring.training.episodes.episode_losses import class_scores as class_scores
from deepring.training.episodes.episode_scheme import Episode as Episode
from deepring.training.episodes.episode_scheme import EpisodeScheme as EpisodeScheme
from deepring.training.episodes.episode_scheme import EpisodeSet as EpisodeSet
from deepring.training.episodes.graded_losses import GradedCrossEntropy as GradedCrossEntropy
from deepring.training.episodes.graded_losses import GradedLoss as GradedLoss
from deepring.training.episodes.graded_losses import SmoothAp as SmoothAp
from deepring.training.episodes.graded_losses import graded_targets as graded_targets
from deepring.training.episodes.places import Places as Places
