"""Checks that a method's index and its files give what the method gives."""

import json
import math
import tempfile
from pathlib import Path

from torch import Tensor

from deepring.evaluation.fingerprint import fingerprint, first_difference
from deepring.methods.method import Method, index_of, rebuild_method
from deepring.methods.network import NetworkMethod
from deepring.methods.network_file import TrainedNetwork, read_network, write_network
from deepring.testing.failure import TOLERANCE, MethodError, away, difference


def check_index(method: Method, descriptors: Tensor) -> str:
    """Assert that the method's index agrees with `compare` in scores, order and turns.

    Returns ''.
    """
    half = len(descriptors) // 2
    queries, database = descriptors[::2], descriptors
    index = index_of(method)
    index.add(database[:half])
    index.add(database[half:])
    if len(index) != len(database):
        raise MethodError("index", f"holds {len(index)} of {len(database)} places that were added")
    score, turn = method.compare(queries, database)
    hits = index.search(queries, len(database))
    slack = TOLERANCE * float(score.abs().max())
    # A method may compare only some entries with a query and give the rest one lowest score.
    width = hits.place.shape[1]
    best = score.sort(dim=1, descending=True).values[:, :width]
    error = float((hits.score - best).abs().max())
    if width < 1 or not error <= slack:
        raise MethodError(
            "index",
            f"the best {width} scores differ by {error:.3g} from those of compare, expected at "
            f"most {slack:.3g}",
        )
    error = float((hits.score - score.gather(1, hits.place)).abs().max())
    if not error <= slack:
        raise MethodError(
            "index",
            f"the scores of its places differ by {error:.3g} from those of compare for the same "
            f"places, expected at most {slack:.3g}",
        )
    if (turn is None) != (hits.turn is None):
        with_turn, without = (
            ("compare", "the index") if hits.turn is None else ("the index", "compare")
        )
        raise MethodError("index", f"{with_turn} returns turns, but {without} does not")
    if turn is not None and hits.turn is not None:
        period = float(getattr(method, "turn_period", 2 * math.pi))
        errors = away(hits.turn - turn.gather(1, hits.place), period).nan_to_num()
        first = float(errors[:, 0].max())  # for lower ranks two shifts may be equally good
        if first > 1e-3:
            raise MethodError(
                "index",
                f"the turn of the best place differs by {first:.3g} rad from compare's, modulo "
                f"{period:.3g}",
            )
    return ""


def check_file(method: Method, rasters: Tensor, descriptors: Tensor) -> str:
    """Assert that the method survives being written to a file and read again.

    A network read from its file must give the same descriptors. Other methods are rebuilt from
    their fingerprint and must give the same scores. Returns why the check does not apply, or ''.
    """
    if isinstance(method, NetworkMethod):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "network.safetensors"
            write_network(path, TrainedNetwork(method, "", ""))
            network = read_network(path, type(method)).method
        error = difference(network.describe(rasters), descriptors)
        if error > 0:
            raise MethodError(
                "file",
                f"read from a file, the network returns descriptors that differ by {error:.3g} of "
                "the largest number, expected 0",
            )
        return ""
    if not hasattr(type(method), "from_fingerprint"):
        return "the class has no from_fingerprint, so its exports can be scored in Python only"
    origin = json.loads(json.dumps(fingerprint(method)))
    copy = rebuild_method(origin, type(method))
    changed = first_difference(origin, fingerprint(copy))
    if changed is not None:
        key, before, after = changed
        raise MethodError(
            "file", f"rebuilt from its fingerprint, {key} is {after!r}, expected {before!r}"
        )
    error = difference(
        copy.compare(descriptors, descriptors).score,
        method.compare(descriptors, descriptors).score,
    )
    if error > 0:
        raise MethodError(
            "file", f"rebuilt from its fingerprint, scores differ by {error:.3g}, expected 0"
        )
    return ""
