"""The HParams page of TensorBoard, as its own plugin reads what runs wrote."""

import numpy as np
from tensorboard.backend.event_processing.data_provider import MultiplexerDataProvider
from tensorboard.backend.event_processing.plugin_event_multiplexer import EventMultiplexer
from tensorboard.context import RequestContext
from tensorboard.plugins.base_plugin import TBContext
from tensorboard.plugins.hparams import api_pb2, list_session_groups
from tensorboard.plugins.hparams.backend_context import Context
from torch.utils.tensorboard import SummaryWriter

from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.protocol import Outcome
from deepring.evaluation.reranked_labels import NAMES
from deepring.reports.hparams_events import add_hparams
from deepring.reports.tensorboard_events import own_figures
from helpers.results import result_of

FIRST = {"method": str, "loss": str, "ways": float, "seed": float, "data": str}


def page(folder):
    """The columns of the page, and the values of each run, by display name."""
    multiplexer = EventMultiplexer().AddRunsFromDirectory(str(folder))
    multiplexer.Reload()
    provider = MultiplexerDataProvider(multiplexer, str(folder))
    backend, request = Context(TBContext(data_provider=provider)), RequestContext()
    metadata = backend.hparams_metadata(request, "")
    known = backend.experiment_from_metadata(request, "", True, metadata, None, 1000)
    statuses = [api_pb2.STATUS_SUCCESS]
    asked = api_pb2.ListSessionGroupsRequest(
        start_index=0, slice_size=100, allowed_statuses=statuses
    )
    found = list_session_groups.Handler(request, backend, "", asked).run().session_groups
    names = {info.name: info.display_name for info in known.hparam_infos}
    figures = {info.name.tag: info.display_name for info in known.metric_infos}
    rows = [
        {names[name]: value.string_value or value.number_value for name, value in g.hparams.items()}
        | {figures[value.name.tag]: round(value.value, 4) for value in g.metric_values}
        for g in found
    ]
    return [*names.values()], [*figures.values()], rows


def write(folder, values, figures):
    with SummaryWriter(str(folder)) as writer:
        add_hparams(writer, values, FIRST, figures)


def test_columns_come_in_their_order_whichever_run_the_page_takes_them_from(tmp_path):
    values = {"seed": 3, "ways": 8, "loss": "CE", "method": "DeepRING", "data": "town"}
    write(tmp_path / "a", {"method": "RING", "seed": 0}, {"recall@1": 0.5, "auc": 0.7})
    write(tmp_path / "b", values | {"more.z": True}, {"recall@1": 0.75, "auc": 0.9})
    hyperparameters, figures, rows = page(tmp_path)
    # By the alphabet it would be data, loss, method, seed, ways, and auc before recall@1.
    assert hyperparameters[:5] == ["method", "loss", "ways", "seed", "data"]
    assert figures == ["recall@1", "auc"]
    wanted = [
        {"method": "RING", "seed": 0, "recall@1": 0.5, "auc": 0.7},
        values | {"recall@1": 0.75, "auc": 0.9},
    ]
    shown = [{key: row[key] for key in row if key != "more.z"} for row in rows]
    assert sorted(shown, key=lambda row: row["method"], reverse=True) == wanted


def test_what_is_of_less_interest_comes_after_and_keeps_its_type(tmp_path):
    given = {"more.b": 2.5, "more.a": "text", "loss": "CE", "more.flag": False}
    write(tmp_path, given, {"recall@1": 0.5})
    hyperparameters, _, (row,) = page(tmp_path)
    assert hyperparameters == [*FIRST, "more.a", "more.b", "more.flag"]
    assert {key: row[key] for key in ("more.a", "more.b", "loss")} == {
        **{"more.a": "text", "more.b": 2.5, "loss": "CE"}
    }


def outcome(method, train, recall, region="test"):
    case = Case(method, train, "town", region)
    one = np.ones((1, 1), dtype=np.float32)
    matches = TopMatches(case, np.zeros(1, int), np.zeros((1, 1), int), one, None, one, one[0])
    return Outcome(matches, [result_of(case, 10.0, rates=(recall, 0.9, 0.8, 0.7))])


def test_figures_are_those_of_the_run_s_own_method_under_names_that_all_methods_have():
    aligned = NAMES["pose"].format("DeepRING")
    trained = [
        *(outcome("DeepRING", "a", 0.5), outcome(aligned, "a", 0.6)),
        *(outcome("RING", "", 0.4), outcome("DeepRING", "a", 0.3, "whole")),
    ]
    figures = own_figures(trained)
    assert [*figures.items()][:3] == [
        *(("recall@1, town test", 0.5), ("recall@1, town whole", 0.3), ("auc, town test", 0.7))
    ]
    assert figures["recall@1, town test + pose re-ranking"] == 0.6
    assert [*figures].index("recall@1, town test + pose re-ranking") == 12  # after all of its own
    fixed = own_figures([outcome("RING", "", 0.4), outcome("Scan Context", "", 0.2)])
    assert fixed["recall@1, town test"] == 0.4
    assert set(fixed) < set(figures)
    assert own_figures([]) == {}
