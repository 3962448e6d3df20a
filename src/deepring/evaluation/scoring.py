"""Scores of exported descriptors: the protocol without scans, images or weights."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.errors import DataError, DeepringError, FileError
from deepring.evaluation.counting import check_grey_zone, count
from deepring.evaluation.descriptors import ENDING, DescriptorSet, read_descriptors
from deepring.evaluation.distances import nearest_distances
from deepring.evaluation.fingerprint import fingerprint, first_difference
from deepring.evaluation.look_up import best_of
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.online import look_up_among
from deepring.evaluation.protocol import BATCH, RADII, Outcome, check_answerable
from deepring.methods.method import Method, rebuild_method
from deepring.progress import Progress
from deepring.text import shown

#: The folder of a run that holds its descriptors.
FOLDER = "descriptors"


def score_descriptors(
    method: Method,
    query: DescriptorSet,
    database: DescriptorSet,
    radii: Sequence[float] = RADII,
    device: torch.device | None = None,
    progress: Progress | None = None,
    wrong_beyond: float | None = None,
) -> Outcome:
    """Evaluate exported descriptors as `evaluate_method` does, at any radii (metres).

    On the device that made them the outcome is the same, except ``seconds_per_query``, which is
    measured again; ``seconds_per_scan`` was measured at the export.

    Raises:
        ConfigError: no radius, one that is not above 0, or a ``wrong_beyond`` below one.
        DataError: sides of different methods or regions; a method that did not make them (for a
            network on the device 'meta' the weights are not compared); no query that has a place
            within the first radius.
    """
    _check_pair(query, database)
    _check_method(method, query)
    searched = _searched(query, database)
    nearest = nearest_distances(query, database, searched)
    check_answerable(query.case, nearest, radii)
    check_grey_zone(radii, wrong_beyond)
    places, queries = _batches(database, device), _batches(query, device, progress)
    hits, per_query = look_up_among(method, places, queries, best_of(len(database)), searched)
    matches = TopMatches.of_hits(query.case, query, database, hits, nearest)
    per_scan = query.seconds_per_scan
    results = count(matches, radii, len(database), per_scan, per_query, wrong_beyond, searched)
    return Outcome(matches, results)


@dataclass(frozen=True)
class Pair:
    """The two descriptor files of a method on a retrieval task."""

    database: Path
    query: Path


def find_pairs(folder: str | Path) -> list[Pair]:
    """The pairs of descriptor files in a folder or in its ``descriptors/``, by name.

    Raises FileError if the folder is missing, holds no files, or one side of a pair is missing.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileError(
            f"{folder}: no such folder; expected the folder of a run, or its {FOLDER}/ with "
            "exported files"
        )
    inside = folder / FOLDER
    source = inside if inside.is_dir() else folder
    endings = {side: f"__{side}{ENDING}" for side in ("database", "query")}
    stems = {
        path.name.removesuffix(ending)
        for ending in endings.values()
        for path in source.glob(f"*{ending}")
        if not path.name.startswith(".")
    }
    if not stems:
        raise FileError(
            f"{source}: no descriptor files in it (*{endings['database']} and "
            f"*{endings['query']}); expected at least one pair, as evaluation.descriptors=true "
            "writes in a run; name another folder"
        )
    pairs = []
    for stem in sorted(stems):
        pair = Pair(*(source / f"{stem}{ending}" for ending in endings.values()))
        for path, partner in ((pair.database, pair.query), (pair.query, pair.database)):
            if not path.is_file():
                raise FileError(
                    f"{path}: missing, but its other side {partner.name} exists; expected both; "
                    f"export again, or delete {partner.name}"
                )
        pairs.append(pair)
    return pairs


def score_pair(
    pair: Pair,
    radii: Sequence[float] = RADII,
    progress: Progress | None = None,
    own_class: str | type | None = None,
    wrong_beyond: float | None = None,
) -> Outcome:
    """`score_descriptors` of two files, with the method rebuilt from their fingerprint.

    ``own_class`` is the class of a method that is not registered, or its dotted path.
    Raises as `read_descriptors`, `rebuild_method` and `score_descriptors` do.
    """
    query, database = read_descriptors(pair.query), read_descriptors(pair.database)
    try:
        _check_pair(query, database)  # before a method is built from one of them
        method = rebuild_method(query.made_by, own_class)
        return score_descriptors(
            method, query, database, radii, progress=progress, wrong_beyond=wrong_beyond
        )
    except DeepringError as error:
        files = f"{pair.query} and {pair.database.name}"
        raise type(error)(f"{files}: {error}", error.argument) from error
    except RuntimeError as error:
        if "meta" not in str(error):
            raise
        raise DataError(
            f"{pair.query}: {query.made_by['method']} compares with its weights, which are not "
            "in the files; score them with score_descriptors in Python and the trained network"
        ) from error


def _batches(
    side: DescriptorSet, device: torch.device | None, progress: Progress | None = None
) -> Iterator[Tensor]:
    """The descriptors of a side as the evaluation looks them up."""
    # A copy in torch's own memory: on other alignments sums come out otherwise in the last digit.
    descriptors = torch.tensor(np.ascontiguousarray(side.descriptors))
    for start in range(0, len(side), BATCH):
        yield descriptors[start : start + BATCH].to(device)
        if progress is not None:
            progress(min(start + BATCH, len(side)), len(side))


def _check_pair(query: DescriptorSet, database: DescriptorSet) -> None:
    """Raise DataError unless the same method made both, for the same region."""
    for side, descriptors in (("query", query), ("database", database)):
        if descriptors.side != side:
            raise DataError(
                f"{_title(descriptors)}: the {descriptors.side} in place of the {side}; expected "
                "one of each; exchange them"
            )
    ours, theirs = (
        {"made_by": side.made_by, **side.case.columns, "shape": list(side.descriptors.shape[1:])}
        for side in (query, database)
    )
    difference = first_difference(ours, theirs)
    if difference is not None:
        key, query_value, database_value = difference
        raise DataError(
            f"{_title(query)}: {key} is {shown(query_value)} for the query and "
            f"{shown(database_value)} for the database; expected both to be made by the same "
            "method, settings and weights, for the same region; export both sides together"
        )


def _searched(query: DescriptorSet, database: DescriptorSet) -> NDArray[np.int64] | None:
    """With how many of the first places each query is compared, (q,); None: with all.

    Raises DataError for online queries of another session than the places, or without a place.
    """
    if query.before is None:
        return None
    searched = np.searchsorted(database.indices, query.before)
    in_order = all((np.diff(a) > 0).all() for a in (query.indices, database.indices))
    if (
        query.session != database.session
        or not in_order
        or searched.min() < 1
        or (query.before > query.indices).any()
        or (np.diff(query.before) < 0).any()
    ):
        raise DataError(
            f"{_title(query)}: before: not that of an online evaluation of one drive, whose "
            "scans are in driving order, and whose queries each have an earlier place; export "
            "both sides again"
        )
    return searched


def _check_method(method: Method, descriptors: DescriptorSet) -> None:
    """Raise DataError unless the method made the descriptors, by its fingerprint and their shape.

    The version of the rasters is not compared, since no raster is made again; the weights are if
    the method has them.
    """
    made_by, ignored = fingerprint(method), {"raster_version"}
    if "weights" not in made_by:
        ignored.add("weights")
    ours, theirs = (
        {key: value for key, value in values.items() if key not in ignored}
        for values in (made_by, descriptors.made_by)
    )
    difference = first_difference({"made_by": ours}, {"made_by": theirs})
    if difference is not None:
        key, value, value_there = difference
        raise DataError(
            f"{_title(descriptors)}: {key} is {shown(value)} for the method and "
            f"{shown(value_there)} for the one that made them; expected the same; take that "
            "method, or export again with this one"
        )
    shape, expected = descriptors.descriptors.shape[1:], getattr(method, "descriptor_shape", None)
    if expected not in (None, shape):
        raise DataError(
            f"{_title(descriptors)}: descriptors of shape {shape}, expected {expected}, as the "
            "method makes them; export them again"
        )


def _title(descriptors: DescriptorSet) -> str:
    case = descriptors.case
    return f"descriptors of {case.method} on {case.test}, {case.region}"
