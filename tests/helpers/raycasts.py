"""A plain ray-by-ray reference for the column caster, and prisms to try it on."""

import numpy as np

from deepring.simulation.fan import Fan
from deepring.simulation.shapes import PrismList, Prisms


def random_prisms(count: int, rng: np.random.Generator) -> Prisms:
    things = PrismList()
    while len(things.rows) < count:
        x, y = rng.uniform(-60, 60, 2)
        if np.hypot(x, y) < 16:
            continue
        z1 = rng.uniform(0.5, 15.0)
        if rng.random() < 0.5:
            size = (rng.uniform(0.5, 20.0), rng.uniform(0.3, 8.0))
            things.box((x, y), size, rng.uniform(-4, 4), (-0.5, z1))
        else:
            things.cylinder((x, y), rng.uniform(0.1, 4.0), (-0.5, z1))
    return things.freeze()


def reference(some_fan: Fan, origin, prisms: Prisms, max_range=100.0):
    """Horizontal distance of every ray, by a three-dimensional test of each ray and prism."""
    c, s = np.cos(some_fan.headings)[:, None], np.sin(some_fan.headings)[:, None]
    slope = some_fan.slopes
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.where(slope < 0, -origin[2] / slope, np.inf)
        for i in range(len(prisms)):
            dx, dy = origin[0] - prisms.x[i], origin[1] - prisms.y[i]
            if prisms.round[i]:
                b, q = dx * c + dy * s, dx**2 + dy**2 - prisms.half_length[i] ** 2
                root = np.sqrt(b**2 - q)  # NaN where the ray passes by
                spans = [(-b - root, -b + root)]
            else:
                cy, sy = np.cos(prisms.yaw[i]), np.sin(prisms.yaw[i])
                spans = [
                    slab(dx * cy + dy * sy, c * cy + s * sy, prisms.half_length[i]),
                    slab(dy * cy - dx * sy, s * cy - c * sy, prisms.half_width[i]),
                ]
            half = (prisms.z1[i] - prisms.z0[i]) / 2
            spans.append(slab(origin[2] - prisms.z0[i] - half, slope, half))
            near = np.max(np.stack([np.broadcast_to(a, slope.shape) for a, _ in spans]), axis=0)
            far = np.min(np.stack([np.broadcast_to(b, slope.shape) for _, b in spans]), axis=0)
            best = np.where((near < far) & (near > 0) & (near < best), near, best)
    return np.where(best * np.sqrt(1 + slope**2) > max_range, np.inf, best)


def slab(start, speed, half):
    a, b = (-half - start) / speed, (half - start) / speed
    return np.minimum(a, b), np.maximum(a, b)
