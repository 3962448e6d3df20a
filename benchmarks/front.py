r"""The animation of the front page: scans, their sinograms, and their places in a map.

    deepring simulate custom -o TOWN --seed 210 world=terraces sensor=hdl64e train_columns=2 \
      test_columns=2
    python benchmarks/front.py TOWN/drive.yaml -o docs/images/front.gif

The map is made of the first drive, with the network of the package. Nothing is chosen: scans stand
at even distances along the second drive.
"""

import argparse
import io
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from deepring import load_network, open_session
from deepring.core.radon import radon
from deepring.data.session import Session
from deepring.io.files import replacing
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.map_building import build_map
from deepring.reports.style import DATABASE, HIT, INK, MISS, PALETTE, new_figure

INCHES, DPI = (8.4, 3.15), 100
MILLISECONDS = 900
COLOURS = 64
#: Metres around the sensor that the first picture shows, and that the network sees.
SEEN = 70.0


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("drive", help="the drive.yaml of `deepring simulate custom`")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the .gif")
    parser.add_argument("--frames", type=int, default=16)
    args = parser.parse_args()
    before, now = (open_session("custom", args.drive, name) for name in ("map", "query"))
    place_map = build_map(before, load_network("shipped").method, ground_z=before.ground_z or 0.0)
    numbers = np.linspace(0, len(now) - 1, args.frames + 1)[:-1].astype(int)
    frames = [frame(place_map, before, now, int(number)) for number in numbers]
    first, *others = in_few_colours(frames)
    with replacing(args.output) as temporary:
        first.save(
            temporary, "GIF", save_all=True, append_images=others, duration=MILLISECONDS, loop=0
        )
    print(f"{args.output}  {args.output.stat().st_size / 1e3:.0f} kB, {len(frames)} scans")


def frame(place_map: Map, before: Session, now: Session, number: int) -> Image.Image:
    """One scan: what it sees, its sinogram, and where the map says that it is."""
    points = now.points(number)
    location = place_map.localize(points)
    bev = torch.from_numpy(place_map.raster(points, place_map.ground_z)).float()
    figure = new_figure(*INCHES)
    scan, sinogram, town = figure.subplots(1, 3)
    draw_scan(scan, points)
    sinogram.imshow(radon(bev[None, None])[0, 0], cmap="magma", aspect="auto")
    sinogram.set_box_aspect(1)
    title(sinogram, "its sinogram: a turn rolls it")
    draw_map(town, before.poses, now.poses[number], location)
    return image_of(figure)


def draw_scan(axes: Axes, points: np.ndarray) -> None:
    near = points[(np.abs(points[:, :2]) < SEEN).all(axis=1)]
    near = near[np.argsort(near[:, 2])]
    axes.scatter(-near[:, 1], near[:, 0], c=near[:, 2], s=0.15, cmap="viridis", vmin=-2, vmax=8)
    axes.plot(0, 0, "^", color=MISS, markersize=7)
    axes.set(xlim=(-SEEN, SEEN), ylim=(-SEEN, SEEN), aspect="equal")
    title(axes, "a scan")


def draw_map(axes: Axes, places: np.ndarray, pose: np.ndarray, found: Location) -> None:
    axes.plot(*places[:, :2, 3].T, ".", color=DATABASE, markersize=3)
    true = pose[:2, 3]
    axes.plot(*true, "o", color=INK, markersize=11, fillstyle="none", label="truth")
    colour = HIT if np.hypot(found.x - true[0], found.y - true[1]) < 2 else MISS
    axes.plot(found.x, found.y, "o", color=colour, markersize=6)
    step = 40 * np.array([np.cos(found.yaw), np.sin(found.yaw)])
    axes.annotate(
        "",
        (found.x + step[0], found.y + step[1]),
        (found.x, found.y),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6},
    )
    axes.margins(0.12)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_box_aspect(1)
    title(axes, "its place and heading in the map")


def title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=10.5, color=INK, loc="left", pad=5)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_color(PALETTE[-1])
        spine.set_linewidth(0.4)


def image_of(figure: Figure) -> Image.Image:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return Image.open(buffer).convert("RGB")


def in_few_colours(frames: list[Image.Image]) -> list[Image.Image]:
    """All frames with one palette, so that nothing changes its colour from frame to frame."""
    width, height = frames[0].size
    strip = Image.new("RGB", (width, height * len(frames)))
    for number, image in enumerate(frames):
        strip.paste(image, (0, height * number))
    palette = strip.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
    return [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in frames]


if __name__ == "__main__":
    main()
