"""Pose tables: rows of numbers as text, poses of them, and poses between two of them.

A pose is a list of three rows of four numbers, world <- sensor.
"""

import math
import re
from collections.abc import Sequence

from fuzz.files import UndecidedError, UndecodableError

Pose = list[list[float]]
Matrix = list[list[float]]

_WHOLE = re.compile(r"[-+]?[0-9]+")
_NUMBER = re.compile(
    r"[-+]?(([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|nan|inf|infinity)", re.IGNORECASE
)
#: How far a rotation may be from one: below the first it surely is one, beyond the second surely
#: not.
_SURELY, _SURELY_NOT = 1e-7, 0.02


def rows_of(content: bytes, delimiter: str | None, kinds: str) -> list[list[float]]:
    """The rows of a table; ``kinds`` has a letter per column: w(hole) or n(umber).

    Text after # is a remark, and a byte order mark no text.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UndecodableError("no text") from None
    rows = []
    for whole in re.split(r"\r\n|\n|\r", text):
        line = whole.partition("#")[0].strip()
        if not line:
            continue
        values = line.split(delimiter)
        if len(values) != len(kinds):
            raise UndecodableError("a row of another length")
        rows.append(
            [_value(value.strip(), kind) for value, kind in zip(values, kinds, strict=True)]
        )
    if not rows:
        raise UndecodableError("no row")
    return rows


def _value(text: str, kind: str) -> float:
    if not (_WHOLE if kind == "w" else _NUMBER).fullmatch(text):
        raise UndecodableError("a value that is no number")
    if kind == "w":
        whole = int(text[:25]) if len(text) > 25 else int(text)
        if not -(2**63) <= whole < 2**63:
            raise UndecodableError("a whole number beyond 64 bits")
        return whole
    return float(text)


def of_matrix(values: Sequence[float]) -> Pose | None:
    """A pose of 12 numbers, row by row; None if it is none."""
    pose = [list(values[k : k + 4]) for k in (0, 4, 8)]
    return pose if _is_rigid(pose) else None


def of_quaternion(values: Sequence[float]) -> Pose | None:
    """A pose of x, y, z, qx, qy, qz, qw; None if it is none."""
    if not all(map(math.isfinite, values)):
        return None
    px, py, pz, x, y, z, w = values
    try:
        length = math.sqrt(x * x + y * y + z * z + w * w)
    except OverflowError:
        return None
    if abs(length - 1) > _SURELY_NOT:
        return None
    if abs(length - 1) > 5e-4:  # rounding to three decimals
        raise UndecidedError
    x, y, z, w = x / length, y / length, z / length, w / length
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), px],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), py],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), pz],
    ]


def of_angles(values: Sequence[float]) -> Pose | None:
    """A pose of x, y, z, roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    if not all(map(math.isfinite, values)):
        return None
    px, py, pz, roll, pitch, yaw = values
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, px],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, py],
        [-sp, cp * sr, cp * cr, pz],
    ]


def compose(first: Pose, second: Pose) -> Pose:
    """first · second."""
    return [
        [
            sum(first[i][k] * second[k][j] for k in range(3)) + (first[i][3] if j == 3 else 0.0)
            for j in range(4)
        ]
        for i in range(3)
    ]


def inverse(pose: Pose) -> Pose:
    """The pose back."""
    turned = [[pose[j][i] for j in range(3)] for i in range(3)]
    moved = [-sum(turned[i][k] * pose[k][3] for k in range(3)) for i in range(3)]
    return [[*turned[i], moved[i]] for i in range(3)]


def between(first: Pose, second: Pose, share: float) -> Pose:
    """The pose a share of the way: straight, and turned about one axis at even speed."""
    back = [[first[j][i] for j in range(3)] for i in range(3)]
    turn = _product(back, [row[:3] for row in second])
    angle, axis = _axis_angle(turn)
    if math.pi - angle < 1e-3:
        raise UndecidedError  # half a turn may go either way
    part = _product([row[:3] for row in first], _turned(axis, share * angle))
    return [[*part[i], first[i][3] + share * (second[i][3] - first[i][3])] for i in range(3)]


def at_stamps(
    stamped: Sequence[tuple[int, Pose | None]], stamps: Sequence[int], tolerance: int
) -> list[tuple[int, Pose]]:
    """(stamp, pose) of those stamps that have one: on a row, or with rows near on both sides."""
    best: dict[int, Pose] = {}
    for stamp, pose in stamped:
        if pose is not None and stamp >= 0:
            best.setdefault(stamp, pose)
    times, found = sorted(best), []
    for stamp in stamps:
        if stamp in best:
            found.append((stamp, best[stamp]))
            continue
        before = [t for t in times if t < stamp]
        after = [t for t in times if t > stamp]
        if not before or not after:
            continue
        a, b = before[-1], after[0]
        if stamp - a <= tolerance and b - stamp <= tolerance:
            found.append((stamp, between(best[a], best[b], (stamp - a) / (b - a))))
    if not found:
        raise UndecodableError("no scan with a pose")
    return found


def _is_rigid(pose: Pose) -> bool:
    if not all(math.isfinite(value) for row in pose for value in row):
        return False
    rows = [row[:3] for row in pose]
    if max(abs(value) for row in rows for value in row) > 2:
        return False
    worst = max(
        abs(sum(a * b for a, b in zip(rows[i], rows[j], strict=True)) - (i == j))
        for i in range(3)
        for j in range(3)
    )
    (a, b, c), (d, e, f), (g, h, i) = rows
    proper = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    if worst > _SURELY_NOT or not proper:
        return False
    if worst > _SURELY:
        raise UndecidedError
    return True


def _product(a: Matrix, b: Matrix) -> Matrix:
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def _axis_angle(turn: Matrix) -> tuple[float, list[float]]:
    axis = [turn[2][1] - turn[1][2], turn[0][2] - turn[2][0], turn[1][0] - turn[0][1]]
    sine = math.sqrt(sum(value * value for value in axis)) / 2
    angle = math.atan2(sine, (turn[0][0] + turn[1][1] + turn[2][2] - 1) / 2)
    if sine < 1e-12:
        return angle, [0.0, 0.0, 1.0]
    return angle, [value / (2 * sine) for value in axis]


def _turned(axis: Sequence[float], angle: float) -> Matrix:
    x, y, z = axis
    c, s = math.cos(angle), math.sin(angle)
    d = 1 - c
    return [
        [c + x * x * d, x * y * d - z * s, x * z * d + y * s],
        [y * x * d + z * s, c + y * y * d, y * z * d - x * s],
        [z * x * d - y * s, z * y * d + x * s, c + z * z * d],
    ]
