"""The train and test regions of a simulated world, in the ground truth's coordinates.

Every world is split along its x axis: crossings of the train part are at x <= 0, those of the test
part at x >= GAP. Places of different regions do not see each other within the 70 m of the
descriptors. The street between the parts crosses the gap and belongs to neither.
"""

#: Width of the strip along x between the two regions (metres).
GAP = 150.0

#: UTM zone 52N easting and northing of the simulated city's origin (metres).
UTM_ORIGIN = (345000.0, 4037000.0)


def _half_plane(x: float, y: float, towards: float) -> list[dict[str, dict[str, list[float]]]]:
    return [{"half_plane": {"point": [x, y], "normal": [towards, 0.0]}}]


#: Regions by layout, for `deepring.data.regions.parse_region` and data configs, the same for all
#: seeds and sizes of worlds. NCLT: north, east. MulRan: easting, northing. Custom: x, y.
REGIONS = {
    "nclt": {"train": _half_plane(0.0, 0.0, -1.0), "test": _half_plane(GAP, 0.0, 1.0)},
    "mulran": {
        "train": _half_plane(*UTM_ORIGIN, -1.0),
        "test": _half_plane(UTM_ORIGIN[0] + GAP, UTM_ORIGIN[1], 1.0),
    },
    "custom": {"train": _half_plane(0.0, 0.0, -1.0), "test": _half_plane(GAP, 0.0, 1.0)},
}
