"""Maps, indexes with their shards, and descriptor files: opened, and searched."""

import hashlib
import json
import math
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import torch

from deepring.evaluation.case import Case
from deepring.evaluation.descriptors import (
    DescriptorSet,
    file_name,
    read_descriptors,
    write_descriptors,
)
from deepring.evaluation.fingerprint import fingerprint
from deepring.evaluation.scoring import find_pairs, score_pair
from deepring.localization.alignment.settings import AlignmentSettings
from deepring.localization.candidates import RerankSettings
from deepring.localization.map import Map
from deepring.methods.scan_context import ScanContext
from deepring.rasters import ContextRaster
from deepring.search.code import CodeSettings
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.search_settings import SearchSettings
from fuzz.decoders import sealed
from fuzz.files import (
    Files,
    Format,
    Mutation,
    UndecidedError,
    UndecodableError,
    in_memory,
    read_back,
)
from fuzz.mutations.raw import raw
from fuzz.mutations.sealed import (
    entries_of,
    forged_layout,
    forged_tensors,
    forged_values,
    parts_of,
    put_together,
)
from fuzz.scenes import scene
from helpers.tiny_methods import deepring

_PLACES = 7
_QUERY = np.array(scene(2), np.float32)
_INDEX = ("index/index.safetensors", "index/00000.safetensors", "index/00001.safetensors")


def formats() -> Iterator[Format]:
    """All files that hold places."""
    for precision in ("int8", "float32"):
        yield Format(
            f"map {precision}",
            lambda _, precision=precision: _map(precision),
            (*_sealed("a.map"), raw("a.map")),
            _located,
            _stated_map,
            weight=8,
        )
    yield Format(
        "index",
        lambda _: _index(),
        (*_sealed(*_INDEX), *_sealed(_INDEX[0]), _whole_shard, _whole_shard, raw(*_INDEX)),
        _searched,
        _stated_index,
        weight=8,
    )
    names = tuple(f"d/{_descriptor_file(side)}" for side in ("database", "query"))
    yield Format(
        "descriptors",
        lambda _: _descriptors(),
        (*_sealed(*names), raw(*names)),
        _scored,
        weight=8,
    )


def _sealed(*names: str) -> tuple[Mutation, ...]:
    values = forged_values(*names)
    return (values, values, values, forged_tensors(*names), forged_layout(*names))


@cache
def _map(precision: str) -> Files:
    rerank = RerankSettings(alignment=AlignmentSettings(cells=24, padded=32), spread=0.0)
    search = SearchSettings(precision, CodeSettings(4, 6))
    place_map = Map(deepring(pool=1), -1.8, search, rerank, points=precision == "int8")
    poses = np.tile(np.eye(4), (_PLACES, 1, 1))
    poses[:, 0, 3] = 10.0 * np.arange(_PLACES)
    scans = [np.array(scene(k), np.float32) for k in range(_PLACES)]
    place_map.add(scans, poses, [f"{k}.bin" for k in range(_PLACES)])
    with tempfile.TemporaryDirectory() as folder:
        place_map.save(Path(folder) / "a.map")
        return read_back(Path(folder))


def _located(folder: Path) -> Any:
    """What a map holds; a scan is located in it, and another one added."""
    place_map = Map.open(folder / "a.map", check=True)
    held = {
        "poses": place_map.places.poses.ravel().tolist() if len(place_map) else [],
        "names": list(place_map.places.names),
        "ground_z": place_map.ground_z,
        "thresholds": [place_map.thresholds.fit, place_map.thresholds.ratio],
        "candidates": place_map.rerank.candidates,
        "extent": place_map.raster.extent,
    }
    with in_memory():
        location = place_map.localize(_QUERY)
        numbers = [location.x, location.y, location.yaw, location.similarity, location.fit]
        if not all(map(math.isfinite, numbers)) or math.isnan(location.ratio):
            held["location"] = numbers
        place_map.add([_QUERY], np.eye(4)[None], ["further"])
    return held


def _stated_map(files: Mapping[str, bytes]) -> Any:
    values, tensors, _ = sealed.decode(files["a.map"], "map")
    try:
        return {
            "poses": sealed.floats(tensors["poses"]),
            "names": values["names"],
            "ground_z": values["ground_z"],
            "thresholds": [values["thresholds"]["fit"], values["thresholds"]["ratio"]],
            "candidates": values["rerank"]["candidates"],
            "extent": values["network"]["settings"]["raster"]["extent"],
        }
    except KeyError:
        raise UndecidedError from None  # settings of a network may take their defaults
    except TypeError:
        raise UndecodableError("no map") from None


@cache
def _index() -> Files:
    settings = SearchSettings("float32", CodeSettings(4, 6), exhaustive_below=0, candidates=5)
    index = CorrelationIndex(settings, cells=2.0)
    generator = torch.Generator().manual_seed(0)
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(2):
            index.add(torch.rand(_PLACES, 12, 10, generator=generator))
            index.save(Path(folder) / "index")
        return read_back(Path(folder))


def _searched(folder: Path) -> Any:
    """What an index holds; it is searched both ways, and grows."""
    index = CorrelationIndex.open(folder / "index", check=True)
    query = torch.rand(2, 12, 10, generator=torch.Generator().manual_seed(1))
    unsound = []
    with in_memory():
        for exhaustive in (True, False) if index.code is not None else (True,):
            hits = index.search(query, 3, exhaustive=exhaustive)
            if not bool(torch.isfinite(hits.score).all()):
                unsound.append("scores")
        index.add(query)
    return {
        "period": index.period,
        "cells": index.cells,
        "candidates": index.settings.candidates,
        "places": len(index) - 2,
        "unsound": unsound,
    }


def _stated_index(files: Mapping[str, bytes]) -> Any:
    values, _, _ = sealed.decode(files[_INDEX[0]], "index")
    try:
        rows = 0
        for number, shard in enumerate(values["shards"]):
            name = f"index/{number:05d}.safetensors"
            stated, tensors, digest = sealed.decode(files.get(name, b""), "index shard")
            if stated != {"number": number} or digest != shard["digest"]:
                raise UndecodableError("another shard")
            rows += tensors["scale"][1][0]
        return {
            "period": values["period"],
            "cells": values["cells"],
            "candidates": values["settings"]["candidates"],
            "places": rows,
            "unsound": [],
        }
    except (KeyError, TypeError, IndexError):
        raise UndecodableError("no index") from None


def _whole_shard(rng: Random, files: Files) -> str:
    """A shard with other contents, and an index that states its digest."""
    number = rng.randrange(2)
    name = _INDEX[1 + number]
    forge = rng.choice((forged_tensors(name), forged_tensors(name), forged_values(name)))
    done = forge(rng, files)
    stated, tensors = parts_of(files[_INDEX[0]])
    try:
        text = parts_text(files[name])
    except (ValueError, KeyError):
        return done
    shard = stated["values"]["shards"][number]
    shard["digest"] = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
    if rng.random() < 0.5:
        shard["rows"] = rng.choice((0, 1, 3, 14, shard["rows"], shard["rows"]))
    stated["tensors"] = entries_of(tensors)
    files[_INDEX[0]] = put_together(json.dumps(stated), tensors)
    return f"{done}, and the index agrees"


def parts_text(content: bytes) -> str:
    """The header text of a sealed file."""
    size = int.from_bytes(content[:8], "little")
    layout = json.loads(content[8 : 8 + size])
    return str(layout["__metadata__"]["deepring_sealed"].partition("\n")[2])


def _descriptor_file(side: Any) -> str:
    return file_name(Case("Scan Context", "", "sim", "test"), side)


@cache
def _descriptors() -> Files:
    method = ScanContext(ContextRaster(sectors=12, rings=6))
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        for side in ("database", "query"):
            images = [np.array(scene(k), np.float32) for k in range(_PLACES)]
            rasters = torch.from_numpy(np.stack([method.raster(p, -1.8) for p in images]))
            held = DescriptorSet(
                case=Case("Scan Context", "", "sim", "test"),
                side=side,
                session=f"2031-{side}",
                made_by=fingerprint(method),
                ground_z=-1.8,
                seconds_per_scan=0.01,
                descriptors=method.describe(rasters).numpy(),
                positions=np.cumsum(rng.uniform(1, 9, (_PLACES, 2)), axis=0),
                indices=np.arange(_PLACES),
            )
            write_descriptors(Path(folder) / "d" / _descriptor_file(side), held)
        return read_back(Path(folder))


def _scored(folder: Path) -> Any:
    """The rates of a folder of descriptors, and what its files state."""
    results = []
    for pair in find_pairs(folder / "d"):
        results += score_pair(pair, [10.0]).results
    held = [read_descriptors(path) for path in sorted((folder / "d").iterdir())]
    stated = [[str(d.case), d.side, d.session, d.ground_z, len(d)] for d in held]
    rates = [[r.recall_1, r.recall_5, r.f1_max, r.auc, r.queries, r.answerable] for r in results]
    return {"rates": rates, "stated": stated}
