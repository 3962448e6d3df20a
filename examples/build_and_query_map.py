"""Build a map, and find scans of another drive in it.

The map is built out of the first drive and saved as one file. Scans of the second drive are located
one by one, without a guess of where they are; the drive's own poses say how far off each answer is.
"""

import math
from pathlib import Path

import numpy as np

from deepring import Map, load_network, open_session
from deepring.localization.map_building import build_map
from deepring.simulation.presets import preset, with_knobs
from deepring.simulation.simulate import simulate

small = {"block": 45.0, "train_columns": 2, "test_columns": 2, "rows": 2, "azimuths": 128}
street = simulate(with_knobs(preset("custom"), {**small, "scan_spacing": 5.0}), Path("street"))
first, second = (open_session("custom", street / "drive.yaml", name) for name in ("map", "query"))

place_map = build_map(first, load_network("shipped").method, spacing=5.0, ground_z=first.ground_z)
place_map.save("street.map")
print(f"{len(place_map)} places in street.map")

place_map = Map.open("street.map")
errors = []
for k in range(0, len(second), 8):
    location = place_map.localize(second.points(k))
    x, y = second.positions[k]
    errors.append(math.hypot(location.x - x, location.y - y))
    trusted = "trusted" if location.trusted else f"not trusted: {location.doubt}"
    print(
        f"scan {k:3}: ({location.x:6.1f}, {location.y:6.1f}) m, heading "
        f"{math.degrees(location.yaw):4.0f}°, off by {errors[-1]:.2f} m, {trusted}"
    )
print(f"half of {len(errors)} scans are off by less than {np.median(errors):.2f} m")
