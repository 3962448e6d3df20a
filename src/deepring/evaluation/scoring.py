"""Scoring exported descriptors: the protocol's look-up, without scans, images or weights."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from deepring.errors import DeepringError
from deepring.evaluation.described import Described
from deepring.evaluation.descriptors import ENDING, Descriptors, read_descriptors
from deepring.evaluation.fingerprint import fingerprint, first_difference
from deepring.evaluation.protocol import RADII, Outcome, check_answerable, score_sides
from deepring.methods.base import Method
from deepring.methods.network import network_class
from deepring.methods.ring import Ring
from deepring.methods.scan_context import ScanContext
from deepring.progress import Progress
from deepring.rasters.kinds import make_raster

#: The methods without weights that a file may name.
HANDCRAFTED: dict[str, Callable[..., Method]] = {
    f"{cls.__module__}.{cls.__qualname__}": cls for cls in (Ring, ScanContext)
}

#: The folder of a run that holds its descriptors.
FOLDER = "descriptors"


def score_descriptors(
    method: Method,
    query: Descriptors,
    database: Descriptors,
    radii: Sequence[float] = RADII,
    device: torch.device | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Count as `evaluate_method` does, on what it has exported, at any radii (metres).

    On the device that described them the outcome is the same, but for ``seconds_per_query``,
    which is measured anew; ``seconds_per_scan`` is the one measured at the export.

    Raises:
        DeepringError: sides that were not made by one and the same thing or not for the same
            region, a method that did not make them (a network on the device 'meta' is told by
            all but its weights), no radius, and no query that has a place within the first.
    """
    _check_pair(query, database)
    _check_method(method, query)
    check_answerable(query.labels, query, database, radii)
    sides = (_described(query), _described(database))
    return score_sides(
        query.labels, method, *sides, radii, query.seconds_per_scan, device, progress
    )


def rebuild_method(made_by: dict[str, Any]) -> Method:
    """A method that compares the descriptors that a `fingerprint` is of, and describes none.

    RING, Scan Context, and networks of any importable `NetworkMethod`. A network's weights are
    not known here: they are put on the device 'meta', where nothing can be computed with them.

    Raises:
        DeepringError: a fingerprint of another method, or one that this version of the code does
            not make the same method of.
    """
    path = str(made_by.get("class"))
    try:
        if path in HANDCRAFTED:
            method: Method = HANDCRAFTED[path](make_raster(made_by["raster"]), **made_by["values"])
        elif "settings" in made_by:
            network = network_class(path)
            method = network(network.settings_class.from_dict(made_by["settings"])).to("meta")
        else:
            raise DeepringError(
                f"class {path}: expected a NetworkMethod, or one of {', '.join(HANDCRAFTED)}; "
                "score descriptors of other methods with score_descriptors in Python"
            )
    except (TypeError, KeyError, AttributeError) as error:
        raise DeepringError(
            f"class {path}: cannot be made of the header's values ({error!r}); expected those of "
            "this version's class; export again"
        ) from error
    return method


@dataclass(frozen=True)
class Pair:
    """The two files of a method on a retrieval set."""

    database: Path
    query: Path


def find_pairs(folder: str | Path) -> list[Pair]:
    """The pairs of descriptor files in a folder or in its ``descriptors/``, by name.

    Raises DeepringError where the folder is missing, holds none, or a file lacks its other side.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DeepringError(
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
        raise DeepringError(
            f"{searched}: no descriptor files in it (*{endings['database']} and "
            f"*{endings['query']}); expected at least one pair; export some, or name another folder"
        )
    pairs = []
    for stem in sorted(stems):
        pair = Pair(*(searched / f"{stem}{ending}" for ending in endings.values()))
        for path, other in ((pair.database, pair.query), (pair.query, pair.database)):
            if not path.is_file():
                raise DeepringError(
                    f"{path}: missing, but its other side is there; expected both; export again, "
                    f"or delete {other.name}"
                )
        pairs.append(pair)
    return pairs


def score_pair(
    pair: Pair, radii: Sequence[float] = RADII, progress: Progress | None = None
) -> Outcome:
    """`score_descriptors` of two files, with the method rebuilt of what they say made them.

    Raises DeepringError as `read_descriptors`, `rebuild_method` and `score_descriptors` do.
    """
    query, database = read_descriptors(pair.query), read_descriptors(pair.database)
    _check_pair(query, database)  # before what only one of them names is built
    method = rebuild_method(query.made_by)
    try:
        return score_descriptors(method, query, database, radii, progress=progress)
    except RuntimeError as error:
        if "meta" not in str(error):
            raise
        raise DeepringError(
            f"{_named(query)}: {query.made_by['class']} compares with its weights, which are not "
            "in the files; score them with score_descriptors in Python and the trained network"
        ) from error


def _described(descriptors: Descriptors) -> Described:
    # A copy in torch's own memory: on other alignments sums come out otherwise in the last digit.
    held = torch.tensor(np.ascontiguousarray(descriptors.descriptors))
    return Described(held, descriptors.positions)


def _check_pair(query: Descriptors, database: Descriptors) -> None:
    """That one and the same thing made both, for the same region."""
    for side, descriptors in (("query", query), ("database", database)):
        if descriptors.side != side:
            raise DeepringError(
                f"{_named(descriptors)}: given as the {side}, but they are the "
                f"{descriptors.side}'s; expected one of each; exchange them"
            )
    found = first_difference(
        {**query.made_by, **vars(query.labels)}, {**database.made_by, **vars(database.labels)}
    )
    shapes = [list(side.descriptors.shape[1:]) for side in (query, database)]
    if found is None and shapes[0] != shapes[1]:
        found = ("shape", shapes[0], shapes[1])
    if found is not None:
        key, ours, theirs = found
        raise DeepringError(
            f"{_named(query)}: {key} is {ours!r} for the query's and {theirs!r} for the "
            "database's; expected both to be made by the same method, settings and weights, for "
            "the same region; export both sides together"
        )


def _check_method(method: Method, descriptors: Descriptors) -> None:
    """That the method made the descriptors, by its fingerprint.

    Rasters are not drawn again, so that another version of them does no harm; weights count where
    the method has them.
    """
    found_by, ignored = fingerprint(method), {"raster_version"}
    if "weights" not in found_by:
        ignored.add("weights")
    ours, theirs = (
        {key: value for key, value in made_by.items() if key not in ignored}
        for made_by in (found_by, descriptors.made_by)
    )
    found = first_difference(ours, theirs)
    if found is not None:
        key, value, wanted = found
        raise DeepringError(
            f"{_named(descriptors)}: {key} is {value!r} for the method and {wanted!r} for the one "
            "that made them; expected the same; take that method, or export again with this one"
        )


def _named(descriptors: Descriptors) -> str:
    return f"descriptors of {descriptors.method} on {descriptors.test}, {descriptors.region}"
