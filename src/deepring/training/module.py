"""The LightningModule: a batch in, a loss out; retrieval in validation."""

from collections.abc import Callable, Iterable
from typing import Any, cast

import lightning as L
import torch
from torch import Tensor, nn
from torchmetrics import Metric

from deepring.errors import DeepringError
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
        method: the network; its class and settings, with the weights, are the checkpoint.
        scheme: puts a batch through the network and the loss.
        loss: one of the scheme's; another raises ConfigError.
        validation: names of the validation sets, in the order of their loaders.
        optimizer: makes the optimizer of the parameters.
        scheduler: makes its schedule, stepped once per epoch; None keeps the rate.
        radius: revisit radius of the validation metrics, metres.
        trained_on: names of the training datasets, kept in the checkpoint.
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
    ) -> None:
        super().__init__()
        scheme.expect_loss(loss)
        self.method, self.scheme, self.loss = method, scheme, loss
        origin = {
            "method": method_name(type(method)),
            "settings": method.settings.to_dict(),
            "trained_on": trained_on,
            "loss": type(self.loss).__name__,
        }
        # Plain values only: a checkpoint must load with weights_only=True.
        self.save_hyperparameters(origin, logger=False)
        self.make_optimizer, self.make_scheduler = optimizer, scheduler
        self.validation = validation or []
        self.recalls = nn.ModuleList(RecallAtK(1, radius) for _ in self.validation)
        self.aucs = nn.ModuleList(PlaceAUC(radius) for _ in self.validation)

    def training_step(self, batch: Any, _: int) -> Tensor:
        """The loss of a batch, by the scheme's step."""
        step = self.scheme.step(self.method, self.loss, batch)
        # A batch counts as one, whatever it holds.
        self.log("train/loss", step.loss, prog_bar=True, batch_size=1)
        self.log("train/accuracy", step.accuracy, prog_bar=True, batch_size=1)
        for name, value in step.parts.items():
            # Of all processes, since training sets go by it between epochs.
            self.log(
                f"train/{name}", value, on_step=False, on_epoch=True, batch_size=1, sync_dist=True
            )
        return step.loss

    def validation_step(self, batch: RetrievalBatch, _: int, dataloader_idx: int = 0) -> None:
        """Look the validation queries up in the validation database."""
        database = describe_all(self.method, batch.database)
        query = describe_all(self.method, batch.query)
        scores = self.method.compare(query, database).score
        name = self.validation[dataloader_idx]
        for label, metrics in (("recall@1", self.recalls), ("auc", self.aucs)):
            metric = cast("Metric", metrics[dataloader_idx])
            metric.update(scores, batch.distances)
            tag = f"val/{name}/{label}"
            self.log(tag, metric, add_dataloader_idx=False, on_epoch=True, on_step=False)

    def on_validation_epoch_end(self) -> None:
        """The figure that checkpoints are chosen by: the mean recall over validation sets."""
        recalls = [cast("Metric", recall).compute() for recall in self.recalls]
        mean = torch.stack(recalls).mean()
        self.log("val/recall@1", mean, prog_bar=True)

    def configure_optimizers(self) -> Any:
        """The configured optimizer, and its schedule by epoch."""
        if self.make_optimizer is None:
            raise DeepringError("optimizer: none given, and training needs one")
        optimizer = self.make_optimizer(self.parameters())
        if self.make_scheduler is None:
            return optimizer
        return {"optimizer": optimizer, "lr_scheduler": self.make_scheduler(optimizer)}
