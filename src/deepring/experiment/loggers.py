"""Where the curves of a training go, and the figures of its evaluation."""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from lightning.pytorch.loggers import Logger, TensorBoardLogger

from deepring import checks
from deepring.errors import ConfigError, DeepringError
from deepring.evaluation.case import in_file_names
from deepring.evaluation.results import RECALLS, Result
from deepring.experiment.hyperparameters import Value
from deepring.experiment.objects import make, target_of
from deepring.text import shown

#: Modules of the loggers of packages that are optional, each by the name of its extra.
_OPTIONAL = {"WandbLogger": "wandb", "MLFlowLogger": "mlflow"}


def make_logger(node: Any) -> Logger | bool:
    """The logger of a config's node; False for none.

    Raises ConfigError for a node of something else, and for a package that is not installed.
    """
    if node is None:
        return False
    name = getattr(target_of(node, "logger"), "__name__", "")
    # Lightning warns each time it leaves the @ of a metric's name out.
    warnings.filterwarnings("ignore", message="MLFlow only allows")
    if name in _OPTIONAL:
        module = _OPTIONAL[name]
        checks.installed("logger", module, module, module)
    return checks.of_type("logger", make(node, "logger"), Logger)


def begin(loggers: Sequence[Logger], hyperparameters: Mapping[str, Value]) -> None:
    """Write the hyperparameters of a training, before its first step.

    TensorBoard gets them with the figures of the evaluation, on one page. Raises ConfigError if a
    logger cannot begin, such as one whose server does not answer.
    """
    for logger in _others(loggers):
        try:
            logger.log_hyperparams(dict(hyperparameters))
        except DeepringError:
            raise
        except Exception as error:  # of whatever kind its package raises
            name = type(logger).__name__
            raise ConfigError(
                f"logger: {name} cannot begin a run ({shown(type(error).__name__, 40)}), expected "
                "its server to answer and you to be logged in; choose logger=csv or "
                "logger=tensorboard, or with wandb logger.offline=true"
            ) from error


def add_results(loggers: Sequence[Logger], results: Sequence[Result]) -> None:
    """Write the figures of an evaluation at its first radius; TensorBoard has them already."""
    head = [result for result in results if result.radius_m == results[0].radius_m]
    for logger in _others(loggers):
        logger.log_metrics(_figures(head))
        logger.save()


def _figures(results: Sequence[Result]) -> dict[str, float]:
    """Figures by name, such as "test/sim_nclt/test/recall_1/RINGplusplus", without the characters
    that MLflow drops: "RING" and "RING++", "recall@1" and "recall@1%" would be one to it."""
    figures = {}
    for result in results:
        case = result.case
        for name in (*RECALLS, "f1_max", "auc", "ap"):
            where = f"{in_file_names(case.test)}/{case.region}/{name}"
            figures[f"test/{where}/{in_file_names(case.method)}"] = getattr(result, name)
    return figures


def _others(loggers: Sequence[Logger]) -> list[Logger]:
    return [logger for logger in loggers if not isinstance(logger, TensorBoardLogger)]
