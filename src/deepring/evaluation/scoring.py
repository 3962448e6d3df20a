"""Scoring exported descriptors: the protocol's look-up, without scans, images or weights."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from deepring.errors import DataError, FileError
from deepring.evaluation.counting import Seconds, count
from deepring.evaluation.descriptors import ENDING, DescriptorSet, read_descriptors
from deepring.evaluation.distances import nearest_distances
from deepring.evaluation.fingerprint import fingerprint, first_difference
from deepring.evaluation.look_up import fill_index, look_up
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.protocol import BATCH, RADII, Outcome, check_answerable
from deepring.methods.base import Method, rebuild_method
from deepring.progress import Progress

#: The folder of a run that holds its descriptors.
FOLDER = "descriptors"


def score_descriptors(
    method: Method,
    query: DescriptorSet,
    database: DescriptorSet,
    radii: Sequence[float] = RADII,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Count as `evaluate_method` does, on what it has exported, at any radii (metres).

    On the device that described them the outcome is the same, but for ``seconds_per_query``,
    which is measured anew; ``seconds_per_scan`` is the one measured at the export.

    Raises:
        DataError: sides that were not made by one and the same thing or not for the same
            region, a method that did not make them (a network on the device 'meta' is told by
            all but its weights), no radius, and no query that has a place within the first.
    """
    _check_pair(query, database)
    _check_method(method, query)
    nearest = nearest_distances(query, database)
    check_answerable(query.case, nearest, radii)
    index = fill_index(method, _batches(database, device))
    hits, per_query = look_up(index, _batches(query, device, progress))
    matches = TopMatches.of_hits(query.case, query, database, hits, nearest)
    seconds = Seconds(query.seconds_per_scan, per_query)
    return Outcome(matches, count(matches, radii, len(database), seconds))


@dataclass(frozen=True)
class Pair:
    """The two files of a method on a retrieval set."""

    database: Path
    query: Path


def find_pairs(folder: str | Path) -> list[Pair]:
    """The pairs of descriptor files in a folder or in its ``descriptors/``, by name.

    Raises FileError where the folder is missing, holds none, or a file lacks its other side.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileError(
            f"{folder}: no such folder; expected a run's, or its {FOLDER}/ with exported files"
        )
    inside = folder / FOLDER
    searched = inside if inside.is_dir() else folder
    endings = {side: f"__{side}{ENDING}" for side in ("database", "query")}
    stems = {
        path.name.removesuffix(ending)
        for ending in endings.values()
        for path in searched.glob(f"*{ending}")
        if not path.name.startswith(".")
    }
    if not stems:
        raise FileError(
            f"{searched}: no descriptor files in it (*{endings['database']} and "
            f"*{endings['query']}); expected at least one pair; export some, or name another folder"
        )
    pairs = []
    for stem in sorted(stems):
        pair = Pair(*(searched / f"{stem}{ending}" for ending in endings.values()))
        for path, other in ((pair.database, pair.query), (pair.query, pair.database)):
            if not path.is_file():
                raise FileError(
                    f"{path}: missing, but its other side is there; expected both; export again, "
                    f"or delete {other.name}"
                )
        pairs.append(pair)
    return pairs


def score_pair(
    pair: Pair,
    radii: Sequence[float] = RADII,
    progress: Progress | None = None,
    own_class: str | type | None = None,
) -> Outcome:
    """`score_descriptors` of two files, with the method rebuilt from their fingerprint.

    ``own_class`` is the user's class, or its dotted path, where the files are of a method that is
    not registered. Raises as `read_descriptors`, `rebuild_method` and `score_descriptors` do.
    """
    query, database = read_descriptors(pair.query), read_descriptors(pair.database)
    _check_pair(query, database)  # before what only one of them names is built
    method = rebuild_method(query.made_by, own_class)
    try:
        return score_descriptors(method, query, database, radii, progress=progress)
    except RuntimeError as error:
        if "meta" not in str(error):
            raise
        raise DataError(
            f"{_named(query)}: {query.made_by['method']} compares with its weights, which are not "
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
    """That one and the same thing made both, for the same region."""
    for side, descriptors in (("query", query), ("database", database)):
        if descriptors.side != side:
            raise DataError(
                f"{_named(descriptors)}: given as the {side}, but they are the "
                f"{descriptors.side}'s; expected one of each; exchange them"
            )
    ours, theirs = (
        {"made_by": side.made_by, **side.case.columns, "shape": list(side.descriptors.shape[1:])}
        for side in (query, database)
    )
    difference = first_difference(ours, theirs)
    if difference is not None:
        key, value, other = difference
        raise DataError(
            f"{_named(query)}: {key} is {value!r} for the query's and {other!r} for the "
            "database's; expected both to be made by the same method, settings and weights, for "
            "the same region; export both sides together"
        )


def _check_method(method: Method, descriptors: DescriptorSet) -> None:
    """That the method made the descriptors, by its fingerprint.

    Rasters are not drawn again, so that another version of them does no harm; weights count where
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
        key, value, wanted = difference
        raise DataError(
            f"{_named(descriptors)}: {key} is {value!r} for the method and {wanted!r} for the one "
            "that made them; expected the same; take that method, or export again with this one"
        )


def _named(descriptors: DescriptorSet) -> str:
    return f"descriptors of {descriptors.method} on {descriptors.test}, {descriptors.region}"
