"""The base classes of a training scheme: sampling, batches, losses, and the training step.

The schemes are `episodes`, `streets`, `tuples`, `pairs`, `poses` and `batch_hard`. They do not need
Lightning; `PlaceModule` and `PlaceDataModule` run any of them.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar

from torch import Tensor, nn
from torch.utils.data import Dataset

from deepring.errors import ConfigError
from deepring.methods.network import NetworkMethod
from deepring.training.training_scans import TrainingScans

Batch = TypeVar("Batch", covariant=True)

Mining = Literal["hardest", "all"]
"""The negatives in a loss: the one most similar to the query, or the mean over all."""


class Step(NamedTuple):
    """The result of a training step."""

    loss: Tensor
    """Scalar, to be minimised."""
    accuracy: Tensor
    """Share of queries whose best match in the batch is correct, detached."""
    parts: dict[str, Tensor]
    """Further scalars to log, detached."""


class TrainingSet(Dataset[Batch], ABC):
    """Batches: item i is batch number i, counted over all epochs.

    An item depends only on its number, the seed and the calls between epochs, so that it is the
    same in every process, with any number of workers and in a resumed run.
    """

    @abstractmethod
    def __len__(self) -> int:
        """Batches per epoch."""

    @abstractmethod
    def __getitem__(self, index: int) -> Batch:
        """Batch ``index``."""

    def before_epoch(self, epoch: int, method: NetworkMethod) -> None:
        """Called in every process before epoch ``epoch``, counted from 0. Does nothing here."""

    def after_epoch(self, parts: Mapping[str, float]) -> None:
        """Called in every process with the epoch's mean of `Step.parts`. Does nothing here."""

    def state_dict(self) -> dict[str, Any]:
        """Plain values that checkpoints store for a resumed run; none here."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the values of `state_dict`."""


class TrainingScheme(ABC):
    """How a network is trained. Subclasses are frozen dataclasses with the settings of sampling."""

    loss_type: ClassVar[type[nn.Module]]
    """Base class of the losses that the scheme's step can call."""

    @abstractmethod
    def training_set(self, scans: TrainingScans, seed: int) -> TrainingSet[Any]:
        """Batches of the scans. Raises DataError or ConfigError for too few scans."""

    @abstractmethod
    def step(self, method: NetworkMethod, loss: Any, batch: Any) -> Step:
        """Describe a batch of the training set and compute a loss of `loss_type`."""

    def expect_method(self, method: NetworkMethod, loss: nn.Module) -> None:  # noqa: B027
        """Raise ConfigError for a method that cannot be trained so; takes every method here.

        It is called with a loss of the scheme before any scan is read.
        """

    def expect_loss(self, loss: nn.Module) -> None:
        """Raise ConfigError unless the loss is one of the scheme's."""
        if not isinstance(loss, self.loss_type):
            raise ConfigError(
                f"loss: {type(loss).__name__}, expected a subclass of {self.loss_type.__name__}, "
                f"the losses of {type(self).__name__}; choose a loss and a sampling that match"
            )


def not_served(scheme: TrainingScheme, method: NetworkMethod, expected: str) -> ConfigError:
    """The error of a method that a scheme cannot train, with what it ``expected``."""
    return ConfigError(
        f"sampling: {type(scheme).__name__} does not serve {method.settings.label}, expected "
        f"{expected}; choose another sampling or method"
    )
