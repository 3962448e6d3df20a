"""Upright prisms, i.e. oriented boxes and cylinders, the only shapes of a world."""

from dataclasses import dataclass, field, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Bits of ``Prisms.sessions``.
DATABASE, QUERY, BOTH = 1, 2, 3

_DTYPES = {  # of the columns that are not float64
    "round": np.bool_,
    "grounded": np.bool_,
    "sessions": np.uint8,
    "kind": np.uint16,
}


class PointClass(IntEnum):
    """What a point lies on. The values are the class ids of SemanticKITTI's label files.

    SemanticKITTI tells more classes apart than a simulated world has: here every moving vehicle is
    a `moving-car`, and every parked one a `car`.
    """

    NOTHING = 0  # unlabeled: no return
    PARKED_CAR = 10  # car
    ROAD = 40  # road: ground up to the kerb
    PARKING = 44  # parking: ground around parked cars
    SIDEWALK = 48  # sidewalk: ground beside the road
    BUILDING = 50  # building: houses, garages, sheds
    WALL = 51  # fence: free-standing walls and fences
    STRUCTURE = 52  # other-structure: tunnels, parking decks
    CROWN = 70  # vegetation: the foliage of trees, hedges and bushes
    TRUNK = 71  # trunk
    TERRAIN = 72  # terrain: all other ground
    POLE = 80  # pole
    OTHER = 99  # other-object: clutter
    MOVING_CAR = 252  # moving-car
    MOVING_PERSON = 254  # moving-person


#: Kinds of ground.
GROUNDS = (PointClass.ROAD, PointClass.TERRAIN, PointClass.SIDEWALK, PointClass.PARKING)


@dataclass(frozen=True, eq=False)
class Prisms:
    """n upright prisms, one array (n,) per property; metres, world frame, z up."""

    x: FloatArray
    y: FloatArray
    z0: FloatArray  # bottom
    z1: FloatArray  # top
    half_length: FloatArray  # along the prism's own x axis; a cylinder's radius
    half_width: FloatArray  # along its own y axis; a cylinder's radius
    yaw: FloatArray
    round: BoolArray  # cylinder instead of box
    depth: FloatArray  # mean free path of a beam inside; 0: opaque
    grounded: BoolArray  # stands on the ground, so that nothing is visible below it
    reflectance: FloatArray  # 0..1
    sessions: NDArray[np.uint8]  # bits DATABASE, QUERY
    kind: NDArray[np.uint16]  # a `PointClass`

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, index: NDArray) -> "Prisms":
        return Prisms(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def __add__(self, other: "Prisms") -> "Prisms":
        pairs = {f.name: (getattr(self, f.name), getattr(other, f.name)) for f in fields(self)}
        return Prisms(**{name: np.concatenate(pair) for name, pair in pairs.items()})

    @property
    def reach(self) -> FloatArray:
        """Radius (n,) of the circle around each footprint (metres)."""
        box = np.hypot(self.half_length, self.half_width)
        return np.where(self.round, self.half_length, box)

    def outline(self) -> FloatArray:
        """Eight points on the bounding box of each footprint, and its centre: (n, 9, 2)."""
        u = np.array([-1, -1, -1, 0, 0, 0, 1, 1, 1]) * self.half_length[:, None]
        v = np.array([-1, 0, 1, -1, 0, 1, -1, 0, 1]) * self.half_width[:, None]
        c, s = np.cos(self.yaw)[:, None], np.sin(self.yaw)[:, None]
        x, y = self.x[:, None] + c * u - s * v, self.y[:, None] + s * u + c * v
        return np.stack([x, y], axis=-1)


@dataclass
class PrismList:
    """Collects prisms one at a time; ``freeze`` turns them into arrays."""

    rows: list[tuple[float, ...]] = field(default_factory=list)

    def box(
        self,
        centre: tuple[float, float],
        size: tuple[float, float],
        yaw: float,
        z: tuple[float, float],
        *,
        reflectance: float = 0.4,
        sessions: int = BOTH,
        kind: int = PointClass.OTHER,
        depth: float = 0.0,
        grounded: bool = True,
    ) -> None:
        """Add a box of ``size`` (length, width): opaque and standing, unless told otherwise.

        With ``depth`` > 0 it is a hedge; without ``grounded`` it may hang, like a ceiling.
        """
        half, solid = (size[0] / 2, size[1] / 2), grounded and depth == 0.0
        row = (*centre, *z, *half, yaw, False, depth, solid, reflectance, sessions, kind)
        self.rows.append(row)

    def cylinder(
        self,
        centre: tuple[float, float],
        radius: float,
        z: tuple[float, float],
        *,
        depth: float = 0.0,
        reflectance: float = 0.4,
        sessions: int = BOTH,
        kind: int = PointClass.OTHER,
    ) -> None:
        """Add a cylinder: opaque and standing, or (``depth`` > 0) a crown above the ground."""
        solid = depth == 0.0
        size = (radius, radius, 0.0)
        self.rows.append((*centre, *z, *size, True, depth, solid, reflectance, sessions, kind))

    def freeze(self) -> Prisms:
        """All prisms added so far."""
        names = [f.name for f in fields(Prisms)]
        table = np.array(self.rows, dtype=np.float64).reshape(-1, len(names))
        columns: dict[str, NDArray] = dict(zip(names, table.T.copy(), strict=True))
        for name, dtype in _DTYPES.items():
            columns[name] = columns[name].astype(dtype)
        return Prisms(**columns)
