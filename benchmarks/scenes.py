"""Scans and descriptors to measure with; the times of no stage depend on their meaning."""

import numpy as np
import torch

from deepring.core.radon import radon
from deepring.core.spectrum import row_dft_magnitude
from deepring.rasters.bev import bev_occupancy


def scan(points: int, seed: int = 0) -> np.ndarray:
    """A street: ground, facades and poles; (points, 3) float32 in random order of the beams."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack(
        [rng.normal(0, 20, (points // 2, 2)), rng.normal(0, 0.03, points // 2)]
    )
    rest = points - len(ground)
    walls = np.concatenate(
        [rng.uniform(-60, 60, (rest, 1)), rng.choice([-12.0, 14.0], (rest, 1))], 1
    )
    across = rng.random(rest) < 0.4
    walls[across] = walls[across][:, ::-1] * [1.0, 0.8]
    walls += rng.normal(0, 0.05, walls.shape)
    facades = np.column_stack([walls, rng.uniform(0, 12, rest)])
    return np.concatenate([ground, facades]).astype(np.float32)


def outline(rng: np.random.Generator) -> np.ndarray:
    """Points (n, 3) of a place: two broken facades, poles and trunks, at any yaw."""
    along = rng.uniform(-60, 60, (2, 1500))
    gaps = np.sin(along / rng.uniform(3, 8) + rng.uniform(0, 6)) > rng.uniform(-0.9, 0.3)
    across = np.array([[-rng.uniform(7, 25)], [rng.uniform(7, 25)]])
    walls = np.stack([along, across + rng.normal(0, 0.3, along.shape)], -1)
    trunks = rng.integers(30, 300)
    poles = rng.uniform(-45, 45, (trunks, 1, 2)) + rng.normal(0, 0.4, (trunks, 4, 2))
    points = np.concatenate([walls[gaps], poles.reshape(-1, 2)])
    return moved(points, rng.uniform(0, 2 * np.pi), np.zeros(2))


def moved(points: np.ndarray, yaw: float, shift: np.ndarray) -> np.ndarray:
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    xy = points[:, :2] @ turn.T + shift
    return np.column_stack([xy, np.ones(len(xy))]).astype(np.float32)


def places(n: int, seed: int = 0) -> torch.Tensor:
    """BEVs (n, 120, 120) of as many places, bool."""
    rng = np.random.default_rng(seed)
    return torch.from_numpy(np.stack([bev_occupancy(outline(rng)) for _ in range(n)]))


def revisits(which: np.ndarray, n: int, seed: int = 0) -> torch.Tensor:
    """BEVs of some of the n places of `places`, seen again turned and 2 m away, 30 % left out."""
    rng = np.random.default_rng(seed)
    outlines = [outline(rng) for _ in range(n)]
    again = np.random.default_rng(seed + 1)
    seen = []
    for k in which:
        kept = outlines[k][again.random(len(outlines[k])) > 0.3]
        seen.append(bev_occupancy(moved(kept, again.uniform(0, 6.28), again.normal(0, 1.4, 2))))
    return torch.from_numpy(np.stack(seen))


def rings(bevs: torch.Tensor, angles: int = 120) -> torch.Tensor:
    """RING's descriptors of BEVs at unit norm: (n, angles, 61)."""
    parts = [row_dft_magnitude(radon(part, angles)) for part in bevs.split(256)]
    found = torch.cat(parts)
    found -= found.mean(dim=(-2, -1), keepdim=True)
    return found / torch.linalg.vector_norm(found, dim=(-2, -1), keepdim=True)
