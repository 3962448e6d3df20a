"""What TensorBoard's HParams page shows of a run: its hyperparameters, and its figures.

The page takes its columns from any one of the runs that it shows, so that each run states all that
are of interest; it sorts hyperparameters by name, and figures not at all
(``_sort_and_reduce_to_hparams_limit`` in ``tensorboard/plugins/hparams/backend_context.py``). It
shows display names, so that a number before the name alone decides the order.
"""

from collections.abc import Mapping
from typing import Any, cast

from tensorboard.compat.proto.summary_pb2 import Summary, SummaryMetadata
from tensorboard.plugins.hparams import metadata
from tensorboard.plugins.hparams.api_pb2 import (
    DATA_TYPE_BOOL,
    DATA_TYPE_FLOAT64,
    DATA_TYPE_STRING,
    STATUS_SUCCESS,
    Experiment,
    HParamInfo,
    MetricInfo,
    MetricName,
)
from tensorboard.plugins.hparams.plugin_data_pb2 import (
    HParamsPluginData,
    SessionEndInfo,
    SessionStartInfo,
)
from torch.utils.tensorboard import FileWriter, SummaryWriter

Value = bool | str | float | int

#: The group of the figures, behind all others in the alphabet. The tags in it are the same in all
#: runs, whatever their methods.
GROUP = "with_hparams"

_TYPES: dict[type, int] = {bool: DATA_TYPE_BOOL, str: DATA_TYPE_STRING}
_FIELDS: dict[type, str] = {bool: "bool_value", str: "string_value"}


def add_hparams(
    writer: SummaryWriter,
    hyperparameters: Mapping[str, Value],
    first: Mapping[str, type],
    figures: Mapping[str, float],
) -> None:
    """Write the hyperparameters and the figures of a run that is done.

    Args:
        writer: of the run.
        hyperparameters: by name.
        first: names and types of the columns of interest, in their order; a run may lack some.
        figures: by name, in their order; the page shows the first five.
    """
    keys = {name: f"{number:02d} {name}" for number, name in enumerate(first)}
    types = dict(first) | {name: type(value) for name, value in hyperparameters.items()}
    experiment = Experiment(
        hparam_infos=[
            HParamInfo(
                name=keys.get(name, name),
                display_name=name,
                type=_TYPES.get(first.get(name, kind), DATA_TYPE_FLOAT64),
            )
            for name, kind in types.items()
        ],
        metric_infos=[
            MetricInfo(name=MetricName(tag=f"{GROUP}/{name}"), display_name=name)
            for name in figures
        ],
    )
    start = SessionStartInfo()
    for name, value in hyperparameters.items():
        field = _FIELDS.get(type(value), "number_value")
        setattr(start.hparams[keys.get(name, name)], field, value)
    _add(writer, metadata.EXPERIMENT_TAG, experiment=experiment)
    _add(writer, metadata.SESSION_START_INFO_TAG, session_start_info=start)
    end = SessionEndInfo(status=STATUS_SUCCESS)
    _add(writer, metadata.SESSION_END_INFO_TAG, session_end_info=end)
    for name, figure in figures.items():
        writer.add_scalar(f"{GROUP}/{name}", figure)


def _add(writer: SummaryWriter, tag: str, **content: Any) -> None:
    data = HParamsPluginData(version=metadata.PLUGIN_DATA_VERSION, **content)
    plugin = SummaryMetadata.PluginData(
        plugin_name=metadata.PLUGIN_NAME, content=data.SerializeToString()
    )
    value = Summary.Value(tag=tag, metadata=SummaryMetadata(plugin_data=plugin))
    cast("FileWriter", writer.file_writer).add_summary(Summary(value=[value]))
