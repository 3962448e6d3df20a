"""Small scans with something to recognise: ground and walls around the sensor, z up."""

import math
import struct
from random import Random

Point = tuple[float, float, float]


def scene(seed: int, points: int = 160, ground: float = -1.8) -> list[Point]:
    """Points of ground and of walls up to 40 m away, as float32."""
    rng = Random(seed)
    found = []
    for _ in range(points // 2):
        away, angle = rng.uniform(4, 40), rng.uniform(-math.pi, math.pi)
        found.append((away * math.cos(angle), away * math.sin(angle), ground + rng.gauss(0, 0.02)))
    walls = [
        (rng.uniform(-30, 30), rng.uniform(-30, 30), rng.uniform(0, math.pi)) for _ in range(8)
    ]
    for _ in range(points - points // 2):
        x, y, angle = rng.choice(walls)
        along = rng.uniform(-8, 8)
        height = ground + rng.uniform(0.4, 7)
        found.append((x + along * math.cos(angle), y + along * math.sin(angle), height))
    return [struct.unpack("<3f", struct.pack("<3f", *point)) for point in found]


def with_missing(points: list[Point]) -> list[Point]:
    """With beams that came back with nothing, as sensors state them."""
    nan = math.nan
    return [*points[:3], (nan, nan, nan), (0.0, 0.0, 0.0), *points[3:], (nan, 0.0, 0.0)]
