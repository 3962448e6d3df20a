"""A new reader: scans and poses in a layout of your own.

Scans here are compressed NumPy files, and one table has a row (name, x, y, yaw) for each. A reader
turns a folder into a `Session`; once registered, `open_session` knows it, and so does all that
takes one.
"""

from pathlib import Path

import numpy as np

from deepring import BevRaster, Session, open_session
from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.readers import register_reader
from deepring.data.readers.reader import Reader, existing_root
from deepring.errors import BrokenScanError


def read_scan(path):
    """Points (n, 3) float32, metres: x forward, y left, z up."""
    try:
        with np.load(path) as file:
            return file["points"].astype(np.float32)
    except (OSError, KeyError, ValueError) as error:
        raise BrokenScanError(f"{path}: no compressed file with an array 'points'") from error


def open_mine(root, name):
    """The session of that name: its files in driving order, and the pose of each."""
    folder = existing_root(root) / name
    rows = [line.split() for line in (folder / "poses.txt").read_text("utf-8").splitlines()]
    x, y, yaw = np.array([row[1:] for row in rows], dtype=np.float64).T
    poses = pose_from(rotation_from_rpy(0.0, 0.0, yaw), np.column_stack([x, y, np.zeros(len(x))]))
    files = tuple(folder / f"{row[0]}.npz" for row in rows)
    return Session(name, files, poses, poses[:, :2, 3], None, read_scan, ground_z=-1.5)


def list_mine(root):
    """The names of all sessions below a folder."""
    return sorted(path.parent.name for path in existing_root(root).glob("*/poses.txt"))


layout = "<session>/<name>.npz with <session>/poses.txt"
register_reader(Reader("mine", "My scans", (layout,), open_mine, list_mine, ("poses.txt",)))

folder = Path("mine/monday")  # four scans of a wall, in the new layout
folder.mkdir(parents=True, exist_ok=True)
wall = np.column_stack([np.full(500, 12.0), np.linspace(-9, 9, 500), np.linspace(-1.5, 3, 500)])
for k in range(4):
    np.savez_compressed(folder / f"scan{k}.npz", points=wall - [2.0 * k, 0.0, 0.0])
(folder / "poses.txt").write_text("".join(f"scan{k} {2 * k} 0 0\n" for k in range(4)), "utf-8")

drive = open_session("mine", "mine", "monday")
print(f"{drive.name}: {len(drive)} scans along {drive.positions[-1, 0] - drive.positions[0, 0]} m")
image = BevRaster()(drive.points(2), drive.ground_z)
print(f"the third scan occupies {image.sum()} of {image.size} cells")
