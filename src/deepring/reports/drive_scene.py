"""A drive with its loops as a scene."""

import numpy as np

from deepring.localization.drives.drive_result import DriveResult
from deepring.reports.round_origin import round_origin
from deepring.reports.scene import BLUE, GREEN, GREY, PURPLE, RED, Lines, Points, Scene, on_screen


def drive_scene(result: DriveResult) -> Scene:
    """Trajectories before and after, and the loops between keyframes; aligned with the truth.

    No line leads across a break of the odometry.
    """
    shapes: list[Points | Lines] = []
    drawn = {name: poses[:, :3, 3] for name, poses in result.aligned().items()}
    if result.truth is not None:
        true = result.truth.poses[result.truth.known][:, :3, 3]
        shapes.append(Lines("true_poses", [true], GREY, on_screen(3.0)))
    for name, positions in drawn.items():
        parts = result.parts(positions)
        shapes.append(Lines(f"{name}/trajectory", parts, _COLOURS[name], on_screen(1.5)))
        keyframes = positions[result.graph.scans]
        names = [result.track.names[row] for row in result.graph.scans]
        shapes.append(Points(f"{name}/keyframes", keyframes, _COLOURS[name], on_screen(2.5), names))
        for loops, colour, words in (
            (result.kept, GREEN, "loops"),
            (result.rejected, RED, "loops_rejected"),
        ):
            strips = [keyframes[[loop.earlier, loop.keyframe]] for loop in loops]
            if strips:
                shapes.append(Lines(f"{name}/{words}", strips, colour, on_screen(1.0)))
    every = np.concatenate(list(drawn.values()))
    return Scene(f"drive {result.track.name}", shapes, round_origin(every))


_COLOURS = {"odometry": PURPLE, "optimized": BLUE}
