"""What a map holds, as the lines that a command prints and as values for JSON."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from deepring.localization.map import Map
from deepring.localization.place_points import VOXEL
from deepring.text import printable


def map_facts(path: Path, place_map: Map) -> Iterator[tuple[str, str]]:
    """What a map holds, as names and values."""
    yield "map", f"{path}, {path.stat().st_size / 1e6:.1f} MB"
    if place_map.source:
        yield "built from", printable(place_map.source)
    for doubt in place_map.doubts:
        yield "doubtful", printable(doubt)
    yield "places", str(len(place_map))
    if len(place_map):
        width, depth = _extent(place_map)
        yield "extent", f"{width:.0f} m x {depth:.0f} m"
    if place_map.points is not None:
        yield "points", f"{place_map.points.count}, one per {VOXEL:g} m of each place"
    settings = place_map.network.settings
    yield "network", f"{settings.label}, {_parameters(place_map)} parameters"
    yield "descriptors", place_map.index.settings.precision
    yield "ground", f"{place_map.ground_z:g} m in the scans' frame"
    yield "trust", f"fit {place_map.thresholds.fit:g}, ratio {place_map.thresholds.ratio:g}"


def map_content(path: Path, place_map: Map) -> dict[str, Any]:
    """What a map holds, for the schema ``map``. A ratio that nothing reaches is null."""
    ratio = place_map.thresholds.ratio
    return {
        "map": path,
        "bytes": path.stat().st_size,
        "built_from": place_map.source,
        "doubts": list(place_map.doubts),
        "places": len(place_map),
        "extent_m": list(_extent(place_map)) if len(place_map) else None,
        "points": None if place_map.points is None else place_map.points.count,
        "network": place_map.network.settings.label,
        "parameters": _parameters(place_map),
        "precision": place_map.index.settings.precision,
        "ground_z": place_map.ground_z,
        "trust": {
            "fit": place_map.thresholds.fit,
            "ratio": ratio if math.isfinite(ratio) else None,
        },
    }


def _extent(place_map: Map) -> tuple[float, float]:
    """Width and depth of the places, metres."""
    width, depth = np.ptp(place_map.places.positions, axis=0)[:2]
    return float(width), float(depth)


def _parameters(place_map: Map) -> int:
    return sum(p.numel() for p in place_map.network.parameters())
