"""Scenes with known answers."""

import numpy as np

from deepring.simulation.ground import Ground


def flat_ground() -> Ground:
    """The plane z = 0: no waves."""
    return Ground(*np.zeros((4, 0)))


def scattered(seed: int, n: int = 4000, radius: float = 45.0) -> np.ndarray:
    """Points on random walls inside ``radius``, so that a shift of 20 m stays in view."""
    rng = np.random.default_rng(seed)
    points = []
    for _ in range(n // 100):
        centre, angle = rng.uniform(-radius, radius, 2) * 0.7, rng.uniform(0, np.pi)
        along = rng.uniform(-10, 10, 100)
        wall = centre + along[:, None] * [np.cos(angle), np.sin(angle)]
        points.append(np.column_stack([wall, rng.uniform(0.5, 8.0, 100)]))
    cloud = np.concatenate(points).astype(np.float32)
    return cloud[np.hypot(cloud[:, 0], cloud[:, 1]) < radius]
