"""A map of places as one HTML page: its facts, its places, and what some of them show."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.data.spacing import sample_of
from deepring.localization.map import Map
from deepring.reports.html import (
    bullets,
    heading,
    page,
    paragraph,
    picture,
    pictures_in_rows,
    table,
)
from deepring.reports.places_figure import places_figure
from deepring.reports.sinograms import draw_bev, draw_sinogram
from deepring.reports.style import new_figure

#: Places whose images are shown, and reasons for leaving scans out.
_SHOWN, _REASONS = 4, 50


def map_page(
    name: str,
    place_map: Map,
    facts: Sequence[tuple[str, str]],
    paths: Sequence[NDArray[np.float64]] = (),
    left_out: Sequence[str] = (),
) -> str:
    """The page, which needs no network and no other file.

    Args:
        name: of the map's file.
        place_map: the map.
        facts: what is known of it, as names and values.
        paths: (n, 2) positions that were driven, metres.
        left_out: why scans or places were left out.
    """
    parts = [table(("", ""), facts)]
    if left_out:
        parts += [heading("Left out"), bullets(left_out, _REASONS)]
    parts.append(heading("Places"))
    if len(place_map):
        figure = places_figure(place_map.places.positions, paths)
        parts.append(picture(figure, "The places from above, in the world of the map's poses"))
        parts += [heading("What places show"), paragraph(_EXPLANATION)]
        parts.append(pictures_in_rows(_pictures(place_map)))
    else:
        parts.append(paragraph("None."))
    return page(f"The map {name}", parts)


_EXPLANATION = (
    "Each place is kept as what stands out of the ground, seen from above, the sensor in the "
    "middle, x forward. Its sinogram sums the image along lines, at every angle θ and offset τ: a "
    "turn of the sensor moves it along θ. The descriptor is made of it."
)


def _pictures(place_map: Map) -> Iterator[str]:
    """Images and sinograms of places spread over the map, two pictures for each."""
    places = sample_of(len(place_map), _SHOWN)
    images = place_map.places.images(torch.tensor(places))
    extent, period = place_map.raster.extent, np.degrees(place_map.network.turn_period)
    with torch.inference_mode():
        sinograms = place_map.network.representation(images)[:, 0].float().cpu().numpy()
    for place, image, sinogram in zip(places, images.numpy(), sinograms, strict=True):
        name = f"{place_map.places.names[place]}, number {place}"
        figure = new_figure(2.9, 2.9)
        draw_bev(figure.add_subplot(), image, "", extent)
        above = picture(figure, f"{name}: {int(image.sum())} occupied cells")
        figure = new_figure(2.9, 2.9)
        top = float(sinogram.max())
        draw_sinogram(figure.add_subplot(), sinogram, "", extent, top, float(period))
        yield above + picture(figure, f"{name}: sinogram")
