"""A map of places as one HTML page: its facts, its places, and what some of them show."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.data.spacing import sample_of
from deepring.localization.map import Map
from deepring.reports.html import (
    bullets,
    figure,
    heading,
    page,
    paragraph,
    pictures_in_rows,
    table,
)
from deepring.reports.places_drawing import places_drawing
from deepring.reports.scan_images import PLACE, defined, laid_out, scan_image, value_image

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
        drawing = places_drawing(place_map.places.positions, paths)
        words = "The places from above, in the world of the map's poses"
        parts.append(figure(drawing, words, "ground"))
        about = _EXPLANATION.format(place_map.raster.extent)
        parts += [heading("What places show"), paragraph(about)]
        parts.append(pictures_in_rows(_pictures(place_map), "couples"))
    else:
        parts.append(paragraph("None."))
    return page(f"The map {name}", parts)


_EXPLANATION = (
    "Each place is kept as what stands out of the ground within {:g} m, seen from above, the "
    "sensor in the middle, x forward, upwards. Its sinogram sums the image along lines, at every "
    "angle θ and offset τ: a turn of the sensor moves it along θ. The descriptor is made of it."
)


def _pictures(place_map: Map) -> Iterator[str]:
    """Images and sinograms of places spread over the map, two pictures for each."""
    places = sample_of(len(place_map), _SHOWN)
    images = place_map.places.images(torch.tensor(places))
    extent, period = place_map.raster.extent, np.degrees(place_map.network.turn_period)
    with torch.inference_mode():
        sinograms = place_map.network.representation(images)[:, 0].float().cpu().numpy()
    for place, image, sinogram in zip(places, images.numpy(), sinograms, strict=True):
        name, own = f"{place_map.places.names[place]}, number {place}", f"place-{place}"
        above = defined([scan_image(own, image.astype(np.bool_), extent, PLACE)])
        above += laid_out(own, extent, f"{name}, from above")
        words = f"{name}: {int(image.sum())} occupied cells"
        axes = f"sinogram (θ down to {period:g}°, τ across)"
        drawn = value_image(sinogram, 0.0, float(sinogram.max()), f"{axes} of {name}", 128)
        yield f"<div>{figure(above, words)}{figure(drawn, f'{name}: {axes}')}</div>"
