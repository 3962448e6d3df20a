"""Describe scans, and compare them.

Two descriptors say how alike two scans are, and by how much the robot turned from one to the other.
The network comes with the package; the street is simulated.
"""

import math
from pathlib import Path

import torch

from deepring import load_network, open_session
from deepring.core.rigid import turn_points
from deepring.simulation.presets import preset, with_knobs
from deepring.simulation.simulate import simulate

small = {"block": 45.0, "train_columns": 2, "test_columns": 2, "rows": 2, "azimuths": 128}
street = simulate(with_knobs(preset("custom"), {**small, "scan_spacing": 5.0}), Path("street"))
drive = open_session("custom", street / "drive.yaml", "map")
network = load_network("shipped").method

here = drive.points(10)  # (n, 3) metres: x forward, y left, z up
scans = {
    "the same scan": here,
    "turned left by 90°": turn_points(here, -math.pi / 2),  # a turn to the left turns points right
    "5 m further": drive.points(11),
    "another street": drive.points(len(drive) // 2),
}
rasters = [network.raster(points, drive.ground_z) for points in scans.values()]
descriptors = network.describe(torch.stack([torch.from_numpy(raster) for raster in rasters]))
score, turn = network.compare(descriptors[:1], descriptors)  # (1, 4) both

for name, alike, radians in zip(scans, score[0].tolist(), turn[0].tolist(), strict=True):
    print(f"{name:20} alike {alike:.2f}, heading {math.degrees(radians):4.0f}° further left")

best = score[0].argsort(descending=True).tolist()
print("most alike first:", *(list(scans)[k] for k in best), sep="\n  ")
