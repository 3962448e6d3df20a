"""Scans for `nowhere.py` by ray casting: worlds, halls and rooms, fields, repeated streets, points.

Each is a cloud (n, 3), metres in the sensor's frame, beside z of the ground under the sensor.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.spacing import sample_by_distance
from deepring.simulation.ground import Ground, rolling_ground
from deepring.simulation.mounting import sensor_of
from deepring.simulation.presets import preset
from deepring.simulation.scene import Scene
from deepring.simulation.sensors import scan
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import PrismList, Prisms
from deepring.simulation.world import moving_objects

Cloud = NDArray[np.float32]
Scan = tuple[Cloud, float]

FLAT = Ground(*np.zeros((4, 0)))


def settings_of(layout: str, seed: int) -> SimulationSettings:
    """A preset; odd seeds have eight prototypes, and the other sensor's blind sector."""
    usual = preset(layout, seed)
    if seed % 2 == 0:
        return usual
    blind = 90.0 if layout == "nclt" else 0.0
    return replace(usual, building_prototypes=8, blind_width_deg=blind)


def world(
    layout: str, seed: int, spacing: float, session: int = 0
) -> Iterator[tuple[Scan, NDArray[np.float64]]]:
    """Scans of a drive through a simulated world, and their poses (4, 4), world <- sensor."""
    scene = Scene(settings_of(layout, seed))
    drive, ground_z = scene.drives[session], -scene.sensors[session].height
    poses = drive.poses(drive.scan_stamps)
    every = np.ones(len(poses), dtype=np.bool_)
    for k in sample_by_distance(poses[:, :2, 3], spacing, every):
        sweep = scene.sweep(session, int(k))
        yield (
            (sweep.points[sweep.valid].astype(np.float32), ground_z),
            poses[k] @ scene.sensors[session].mount,
        )


def sector(cloud: Cloud, degrees: float, middle: float) -> Cloud:
    """What a sensor sees whose field of view is ``degrees`` wide, around the azimuth ``middle``."""
    away = np.degrees(np.arctan2(cloud[:, 1], cloud[:, 0])) - middle
    return cloud[np.abs((away + 180) % 360 - 180) <= degrees / 2]


def random_points(rng: np.random.Generator) -> Scan:
    """Points without a scene: even over a disc, in clumps, or along lines."""
    count, radius = int(10 ** rng.uniform(2.5, 4.5)), rng.uniform(10, 70)
    kind = rng.integers(3)
    if kind == 0:
        xy = rng.normal(size=(count, 2))
        xy *= radius * np.sqrt(rng.random((count, 1))) / np.linalg.norm(xy, axis=1, keepdims=True)
    elif kind == 1:
        centres = rng.uniform(-radius, radius, (int(rng.integers(3, 60)), 2))
        xy = centres[rng.integers(len(centres), size=count)]
        xy = xy + rng.normal(0, rng.uniform(0.3, 5), xy.shape)
    else:
        lines = int(rng.integers(2, 60))
        which, angle = rng.integers(lines, size=count), rng.uniform(0, np.pi, lines)
        centre, half = rng.uniform(-radius, radius, (lines, 2)), rng.uniform(2, 30, lines)
        along = (rng.uniform(-1, 1, count) * half[which])[:, None]
        xy = centre[which] + along * np.stack([np.cos(angle), np.sin(angle)], 1)[which]
    ground = np.column_stack([rng.uniform(-70, 70, (4000, 2)), np.zeros(4000)])
    points = np.column_stack([xy, rng.uniform(0.6, 8.0, count)])
    return np.concatenate([ground, points]).astype(np.float32), 0.0


def _sweep(
    prisms: Prisms, layout: str, rng: np.random.Generator, at: NDArray[np.float64], ground: Ground
) -> Scan:
    """One scan of prisms from a pose (4, 4) on the ground."""
    settings = replace(preset(layout), blind_width_deg=0.0)
    sensor = sensor_of(settings, 0)
    body = at.copy()
    body[2, 3] += sensor.body_height + float(ground.height(*at[:2, 3]))
    sweep = scan(sensor, body, rng.uniform(0, 2 * np.pi), prisms, ground, settings, rng)
    return sweep.points[sweep.valid].astype(np.float32), -sensor.height


def _standing(rng: np.random.Generator, x: float = 0.0, y: float = 0.0) -> NDArray[np.float64]:
    tilt = rng.normal(0, np.deg2rad(1.0), 2)
    return pose_from(rotation_from_rpy(*tilt, rng.uniform(0, 2 * np.pi)), [x, y, 0.0])


def field(rng: np.random.Generator, layout: str) -> Scan:
    """Open land: trees, poles, sheds, hedges and fences, 4 to 60 of them within 70 m."""
    things = PrismList()
    for _ in range(int(rng.integers(4, 60))):
        away, angle = rng.uniform(5, 70), rng.uniform(0, 2 * np.pi)
        centre = (float(away * np.cos(angle)), float(away * np.sin(angle)))
        kind = rng.integers(4)
        if kind == 0:
            things.cylinder(centre, rng.uniform(0.1, 0.4), (-2.0, 4.0))
            things.cylinder(centre, rng.uniform(1.5, 4.0), (2.0, 9.0), depth=2.0)
        elif kind == 1:
            things.cylinder(centre, 0.12, (-2.0, 7.0))
        else:
            length = rng.uniform(2, 8) if kind == 2 else rng.uniform(5, 40)
            width, height = (rng.uniform(2, 6), 3.0) if kind == 2 else (0.6, 1.6)
            things.box(centre, (length, width), rng.uniform(0, np.pi), (-2.0, height))
    return _sweep(things.freeze(), layout, rng, _standing(rng), rolling_ground(0.5, rng))


def indoor(rng: np.random.Generator, layout: str) -> Scan:
    """A room, a corridor, a parking deck or a store of racks, under a ceiling."""
    kind = rng.integers(4)
    draw = (_room, _corridor, _parking, _store)[kind]
    things, ceiling = PrismList(), (3.0, 2.8, 2.5, 8.0)[kind]
    at = draw(things, rng)
    cloud, ground_z = _sweep(things.freeze(), layout, rng, at, FLAT)
    # The walls are higher than the ceiling: where a beam passes it, it ends there.
    top = ceiling + ground_z
    share = np.where(cloud[:, 2] > top, top / np.maximum(cloud[:, 2], 1e-6), 1.0)
    return (cloud * share[:, None]).astype(np.float32), ground_z


def _walls(things: PrismList, length: float, width: float) -> None:
    for side in (-1.0, 1.0):
        things.box((0.0, side * width / 2), (length + 0.4, 0.3), 0.0, (-1.0, 40.0))
        things.box((side * length / 2, 0.0), (0.3, width + 0.4), 0.0, (-1.0, 40.0))


def _inside(rng: np.random.Generator, length: float, width: float) -> tuple[float, float]:
    return float(rng.uniform(-0.5, 0.5) * length), float(rng.uniform(-0.5, 0.5) * width)


def _room(things: PrismList, rng: np.random.Generator) -> NDArray[np.float64]:
    length, width = rng.uniform(6, 40), rng.uniform(5, 25)
    _walls(things, length, width)
    at = _inside(rng, length - 3, width - 3)
    for _ in range(int(rng.integers(3, 40))):
        centre = _inside(rng, length - 2, width - 2)
        if np.hypot(centre[0] - at[0], centre[1] - at[1]) > 2.5:
            size = (rng.uniform(0.4, 2.5), rng.uniform(0.4, 1.2))
            things.box(centre, size, rng.integers(2) * np.pi / 2, (-1.0, rng.uniform(0.7, 2.2)))
    return _standing(rng, *at)


def _corridor(things: PrismList, rng: np.random.Generator) -> NDArray[np.float64]:
    length, width, pitch = rng.uniform(30, 140), rng.uniform(1.8, 4.0), rng.uniform(3.5, 8.0)
    gaps = {int(rng.integers(-9, 9)) for _ in range(int(rng.integers(0, 4)))}
    for k in range(-int(length / 2 / pitch), int(length / 2 / pitch) + 1):
        for side in (-1.0, 1.0):
            door = rng.random() < 0.15
            if k in gaps and side > 0:
                continue  # another corridor opens
            deep = 4.0 if door else 0.0
            centre = (k * pitch, side * (width / 2 + deep + 0.15))
            things.box(centre, (pitch - (0.0 if not door else 0.9), 0.3), 0.0, (-1.0, 40.0))
            things.box((k * pitch, side * (width / 2 + 0.1)), (pitch * 0.7, 0.3), 0.0, (-1.0, 40.0))
    for side in (-1.0, 1.0):
        things.box((side * length / 2, 0.0), (0.3, width + 20), 0.0, (-1.0, 40.0))
    return _standing(rng, rng.uniform(-0.4, 0.4) * length, rng.uniform(-0.3, 0.3) * (width - 1))


def _parking(things: PrismList, rng: np.random.Generator) -> NDArray[np.float64]:
    length, width, pitch = rng.uniform(40, 130), rng.uniform(30, 80), rng.uniform(5.0, 8.5)
    _walls(things, length, width)
    aisles = np.arange(-width / 2 + 8.0, width / 2 - 7.0, 16.0)
    for y in aisles:
        for x in np.arange(-length / 2 + 3.0, length / 2 - 2.0, 2.5):
            for side in (-1.0, 1.0):
                if rng.random() < 0.5:
                    size = (1.8, rng.uniform(3.8, 4.8))
                    things.box((float(x), float(y + side * 5.5)), size, 0.0, (-1.0, 1.5))
        for x in np.arange(-length / 2 + pitch, length / 2 - 1.0, pitch):
            things.box((float(x), float(y + 8.0)), (0.6, 0.6), 0.0, (-1.0, 40.0))
    return _standing(rng, rng.uniform(-0.4, 0.4) * length, float(rng.choice(aisles)))


def _store(things: PrismList, rng: np.random.Generator) -> NDArray[np.float64]:
    length, width, pitch = rng.uniform(30, 110), rng.uniform(20, 60), rng.uniform(3.5, 5.5)
    _walls(things, length, width)
    racks = np.arange(-width / 2 + 2.0, width / 2 - 1.0, pitch)
    for y in racks:
        for x in np.arange(-length / 2 + 5.0, length / 2 - 5.0, 2.7):
            if rng.random() < 0.9:
                things.box((float(x), float(y)), (2.4, 1.1), 0.0, (-1.0, rng.uniform(1.0, 7.5)))
    return _standing(rng, rng.uniform(-0.45, 0.45) * length, float(rng.choice(racks)) + pitch / 2)


class Road:
    """A road between two walls, straight and the same all along: nothing says where along it."""

    def __init__(self, layout: str, rng: np.random.Generator) -> None:
        self.layout, self.half_width = layout, float(rng.uniform(4.0, 14.0))
        things = PrismList()
        for side in (-1.0, 1.0):
            things.box((0.0, side * self.half_width), (2000.0, 0.4), 0.0, (-1.0, 5.0))
        self.walls = things.freeze()

    def scan(self, along: float, rng: np.random.Generator) -> tuple[Scan, NDArray[np.float64]]:
        """A scan from somewhere across the road, any heading, and its pose (4, 4)."""
        pose = _standing(rng, along, 0.3 * self.half_width * float(rng.uniform(-1, 1)))
        mount = sensor_of(preset(self.layout), 0).mount
        return _sweep(self.walls, self.layout, rng, pose, FLAT), pose @ mount


class RepeatedStreets:
    """A city whose blocks are all the same: one block of a simulated world, laid side by side."""

    def __init__(self, layout: str, seed: int, blocks: int) -> None:
        self.settings = replace(
            preset(layout, seed), crossing_jitter=0.0, ground_relief=0.0, blind_width_deg=0.0
        )
        scene = Scene(self.settings)
        self.blocks, self.layout = blocks, layout
        crossings = scene.world.streets.crossings.reshape(-1, self.settings.rows, 2)
        corner = crossings[self.settings.train_columns + 1, 0]
        self.standing = []
        for session in (1, 2):
            prisms = scene.world.standing(session, self.settings)
            x, y = prisms.x - corner[0], prisms.y - corner[1]
            inside = (x >= 0) & (x < self.block) & (y >= 0) & (y < self.block)
            one = replace(prisms, x=x, y=y)[np.flatnonzero(inside)]
            copies = [
                replace(one, x=one.x + i * self.block, y=one.y + j * self.block)
                for i in range(blocks)
                for j in range(blocks)
            ]
            every = copies[0]
            for copy in copies[1:]:
                every = every + copy
            self.standing.append(every)

    @property
    def block(self) -> float:
        """Metres from a crossing to the next."""
        return self.settings.block

    def on_streets(self, spacing: float) -> NDArray[np.float64]:
        """Positions (n, 2) every ``spacing`` metres along the inner streets."""
        along = np.arange(0.0, self.blocks * self.block, spacing)
        inner = self.block * np.arange(1, self.blocks)
        rows = [(s, t) for t in inner for s in along] + [(t, s) for t in inner for s in along]
        return np.array(rows)

    def scan(
        self, session: int, position: NDArray[np.float64], rng: np.random.Generator
    ) -> tuple[Scan, NDArray[np.float64]]:
        """A scan at a position, with its own moving objects, and its pose (4, 4)."""
        pose = _standing(rng, *(position + rng.uniform(-2, 2, 2)))
        movers = moving_objects(pose, FLAT, self.settings, rng)
        cloud = _sweep(self.standing[session] + movers, self.layout, rng, pose, FLAT)
        return cloud, pose @ sensor_of(self.settings, 0).mount
