"""A scene: one world and two drives through it, which can be scanned in memory."""

from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.drive import Drive, plan_drives
from deepring.simulation.mounting import Sensor, sensor_of
from deepring.simulation.sensors import Sweep, scan, scan_in_motion
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import DATABASE, QUERY, Prisms
from deepring.simulation.world import World, build_world, moving_objects

FloatArray = NDArray[np.float64]


class Scene:
    """World, drives and scans of ``settings``. Session 0 is the database, 1 the query."""

    def __init__(self, settings: SimulationSettings) -> None:
        self.settings = settings
        self.sensors: tuple[Sensor, Sensor] = (sensor_of(settings, 0), sensor_of(settings, 1))
        self.world: World = build_world(settings)
        self.drives: tuple[Drive, Drive] = plan_drives(self.world, settings)

    @cached_property
    def _standing(self) -> tuple[Prisms, Prisms]:
        database, query = (self.world.standing(s, self.settings) for s in (DATABASE, QUERY))
        return database, query

    def sweep(self, session: int, index: int) -> Sweep:
        """Scan ``index`` of a session, with its own random numbers: the same on each call.

        With motion distortion it begins at the scan's stamp, whose pose the ground truth has.
        """
        settings, drive, sensor = self.settings, self.drives[session], self.sensors[session]
        rng = np.random.default_rng([settings.seed, 4, session, index])
        stamp = drive.scan_stamps[index : index + 1]
        pose = drive.poses(stamp)[0]
        movers = moving_objects(pose, self.world.ground, settings, rng)
        phase = rng.uniform(0.0, 2 * np.pi) if sensor.starts_anywhere else 0.0
        prisms = self._standing[session] + movers
        ground, cover = self.world.ground, self.world.cover
        if not settings.motion_distortion:
            return scan(sensor, pose, phase, prisms, ground, settings, rng, cover)

        def motion(seconds: FloatArray) -> FloatArray:
            return drive.poses(stamp + np.round(seconds * 1e6).astype(np.int64))

        return scan_in_motion(sensor, motion, phase, prisms, ground, settings, rng, cover)


@lru_cache(maxsize=1)
def scene_of(settings: SimulationSettings) -> Scene:
    """The scene of ``settings``, cached, so that a worker builds it once."""
    return Scene(settings)
