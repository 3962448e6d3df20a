"""What a training scheme is: its batches, their losses, a training step, the time between epochs.

`episodes`, `tuples` and `batch_hard` are schemes. None of them needs Lightning; `PlaceModule`
and `PlaceDataModule` run whichever they are given.
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
"""Which wrong places count in a loss: the one most like the query, or the mean over all."""


class Step(NamedTuple):
    """What a loss makes of a batch."""

    loss: Tensor
    """Scalar, to be minimised."""
    accuracy: Tensor
    """Share of queries that find their own place in the batch, detached."""
    parts: dict[str, Tensor]
    """Other scalars worth a curve, detached."""


class TrainingSet(Dataset[Batch], ABC):
    """Batches: item i is batch number i, counted through all epochs.

    An item depends on its number, the seed, and what the set was told between epochs, so that it
    is the same in every process, for any number of workers and in a resumed run.
    """

    @abstractmethod
    def __len__(self) -> int:
        """Batches per epoch."""

    @abstractmethod
    def __getitem__(self, index: int) -> Batch:
        """Draw batch ``index``."""

    def before_epoch(self, epoch: int, method: NetworkMethod) -> None:
        """Called in every process before epoch ``epoch``, counted from 0. Does nothing here."""

    def after_epoch(self, parts: Mapping[str, float]) -> None:
        """Called in every process with the epoch's mean of `Step.parts`. Does nothing here."""

    def state_dict(self) -> dict[str, Any]:
        """Plain values that a checkpoint keeps for a resumed run; none here."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up what `state_dict` gave."""


class TrainingScheme(ABC):
    """How a network is trained. Subclasses are frozen dataclasses of the settings of sampling."""

    loss_type: ClassVar[type[nn.Module]]
    """Base class of the losses that the scheme's step can call."""

    @abstractmethod
    def training_set(self, scans: TrainingScans, seed: int) -> TrainingSet[Any]:
        """Batches of the scans. Raises DataError or ConfigError where there are too few scans."""

    @abstractmethod
    def step(self, method: NetworkMethod, loss: Any, batch: Any) -> Step:
        """Put a batch of the training set through the network and a loss of `loss_type`."""

    def expect_loss(self, loss: nn.Module) -> None:
        """Raise ConfigError unless the loss is one of the scheme's."""
        if not isinstance(loss, self.loss_type):
            raise ConfigError(
                f"loss: {type(loss).__name__}, expected a subclass of {self.loss_type.__name__}, "
                f"which {type(self).__name__} trains with; choose a loss and a sampling that go "
                "together, as method=NAME does"
            )
