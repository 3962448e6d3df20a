"""The LightningModule: training steps by a scheme, retrieval in validation."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, cast

import lightning as L
import torch
from torch import Tensor, nn
from torchmetrics import Metric

from deepring.errors import ConfigError
from deepring.evaluation.batched_metrics import PlaceAUC, RecallAtK
from deepring.methods.method import describe_all
from deepring.methods.network import NetworkMethod
from deepring.methods.registry import method_name
from deepring.training.datamodule import RetrievalBatch
from deepring.training.scheme import TrainingScheme

MakeOptimizer = Callable[[Iterable[nn.Parameter]], torch.optim.Optimizer]
MakeScheduler = Callable[[torch.optim.Optimizer], torch.optim.lr_scheduler.LRScheduler]


class PlaceModule(L.LightningModule):
    """A method under training.

    Args:
        method: the network; a checkpoint holds its name, settings and weights.
        scheme: computes the loss of a batch.
        loss: a loss of the scheme; any other raises ConfigError, as does a method that the two
            cannot train.
        validation: names of the validation sets, in the order of their loaders.
        optimizer: makes the optimizer of the parameters.
        scheduler: makes its schedule, stepped once per epoch; None keeps the rate constant.
        radius: revisit radius of the validation metrics, metres.
        trained_on: names of the training datasets, stored in the checkpoint.
        parts: names of the parts that are trained, see `NetworkMethod.parts`; the others keep their
            weights and batch statistics. None trains all. Raises ConfigError for other names.
        trained_before: the parts that an earlier stage trained.
    """

    def __init__(
        self,
        method: NetworkMethod,
        scheme: TrainingScheme,
        loss: nn.Module,
        validation: list[str] | None = None,
        optimizer: MakeOptimizer | None = None,
        scheduler: MakeScheduler | None = None,
        radius: float = 10.0,
        trained_on: str = "",
        parts: Sequence[str] | None = None,
        trained_before: Sequence[str] = (),
    ) -> None:
        super().__init__()
        scheme.expect_loss(loss)
        scheme.expect_method(method, loss)
        self.method, self.scheme, self.loss = method, scheme, loss
        self.parts = None if parts is None else _known_parts(method, parts)
        if self.parts is not None:
            for name, weight in method.named_parameters():
                weight.requires_grad_(name.partition(".")[0] in self.parts)
        trained = {*trained_before, *(method.parts if self.parts is None else self.parts)}
        origin = {
            "method": method_name(type(method)),
            "settings": method.settings.to_dict(),
            "trained_on": trained_on,
            "loss": type(self.loss).__name__,
            "trained_parts": self.parts,
            "untrained": [part for part in method.parts if part not in trained],
        }
        # Only plain values, so that checkpoints load with ``weights_only=True``.
        self.save_hyperparameters(origin, logger=False)
        self.make_optimizer, self.make_scheduler = optimizer, scheduler
        self.validation = validation or []
        self.recalls = nn.ModuleList(RecallAtK(1, radius) for _ in self.validation)
        self.aucs = nn.ModuleList(PlaceAUC(radius) for _ in self.validation)

    def on_train_start(self) -> None:
        """Set parts that are not trained to evaluation mode, so that their statistics stay."""
        if self.parts is not None:
            for name, part in self.method.named_children():
                if name not in self.parts:
                    part.eval()

    def training_step(self, batch: Any, _: int) -> Tensor:
        """The loss of a batch, by the scheme's step."""
        step = self.scheme.step(self.method, self.loss, batch)
        # All batches have equal weight, whatever their size.
        self.log("train/loss", step.loss, prog_bar=True, batch_size=1)
        self.log("train/accuracy", step.accuracy, prog_bar=True, batch_size=1)
        for name, value in step.parts.items():
            # Averaged over all processes, since training sets use it between epochs.
            self.log(
                f"train/{name}", value, on_step=False, on_epoch=True, batch_size=1, sync_dist=True
            )
        return step.loss

    def validation_step(self, batch: RetrievalBatch, _: int, dataloader_idx: int = 0) -> None:
        """Look the validation queries up in the validation database."""
        database = describe_all(self.method, batch.database)
        query = describe_all(self.method, batch.query)
        scores = self.method.compare(query, database).score
        scores = scores.masked_fill(batch.distances.isinf(), -torch.inf)  # too recent: not compared
        name = self.validation[dataloader_idx]
        for label, metrics in (("recall@1", self.recalls), ("auc", self.aucs)):
            metric = cast("Metric", metrics[dataloader_idx])
            metric.update(scores, batch.distances)
            tag = f"val/{name}/{label}"
            self.log(tag, metric, add_dataloader_idx=False, on_epoch=True, on_step=False)

    def on_validation_epoch_end(self) -> None:
        """Log the criterion of checkpoints, the mean recall over validation sets."""
        recalls = [cast("Metric", recall).compute() for recall in self.recalls]
        mean = torch.stack(recalls).mean()
        self.log("val/recall@1", mean, prog_bar=True)

    def configure_optimizers(self) -> Any:
        """The configured optimizer and its schedule per epoch."""
        if self.make_optimizer is None:
            raise ConfigError("optimizer: None, expected a function that makes one for training")
        optimizer = self.make_optimizer([w for w in self.parameters() if w.requires_grad])
        if self.make_scheduler is None:
            return optimizer
        scheduler = {"scheduler": self.make_scheduler(optimizer), "name": "train/lr"}
        return {"optimizer": optimizer, "lr_scheduler": scheduler}


def _known_parts(method: NetworkMethod, parts: Sequence[str]) -> list[str]:
    """The parts, in the network's order. Raises ConfigError unless they are some of its own."""
    if not parts or not set(parts) <= set(method.parts):
        raise ConfigError(
            f"trained_parts: {list(parts)}, expected one or more of {', '.join(method.parts)}, the "
            f"parts of {method.settings.label}, or null for all"
        )
    return [part for part in method.parts if part in parts]
