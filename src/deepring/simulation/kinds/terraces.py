"""Terraced streets: rows of houses close to a narrow street, villas in gardens, parked cars."""

from deepring.simulation.furnish import park_row, place_lamps, place_tree
from deepring.simulation.kinds.gardens import place_border, place_villa
from deepring.simulation.kinds.houses import TERRACE, TOWN, place_row
from deepring.simulation.kinds.kerbs import place_kerbside
from deepring.simulation.kinds.openings import place_opening
from deepring.simulation.streets import Streets
from deepring.simulation.yard import StreetSide, Yard, sides_of

_OPENINGS, _ROWS = 0.1, 0.4  # shares of the plots; the others are villas
_PARKED = 1.0  # a row of parked cars is this far beyond the free street (metres)
_PAVEMENT = (3.0, 4.2)  # and the gardens and fronts so far, in a range
_PASSAGE = (1.2, 3.5)  # width of the passages between rows


def furnish(streets: Streets, yard: Yard, cars: Yard) -> None:
    """Furnish every street: in the old town, or among terraces and villas with gardens."""
    for street in streets.all:
        old_town = yard.chance(0.3)
        for side in sides_of(street, streets):
            furnish_side(side, old_town, yard, cars)


def furnish_side(side: StreetSide, old_town: bool, yard: Yard, cars: Yard) -> None:
    """Furnish one side of a street up to its crossings."""
    line = yard.settings.corridor + yard.between(*_PAVEMENT)
    span = side.span(line + 0.5)
    if old_town:
        place_row(side, span, line + yard.between(0.0, 0.8), TOWN, yard)
    else:
        _place_homes(side, span, line, yard, cars)
        if yard.chance(0.3):
            _place_avenue(side, span, line - 0.9, yard)
    place_lamps(side, line - 0.4, yard)
    place_kerbside(side, line - 0.5, yard)
    if yard.chance(0.75):
        begin, end = side.span(line + 4.0)
        row = yard.settings.corridor + _PARKED
        park_row(side, (begin + yard.between(0.0, 12.0), end), row, cars, yard.between(5.4, 6.4))


def _place_homes(
    side: StreetSide, span: tuple[float, float], line: float, yard: Yard, cars: Yard
) -> None:
    """Villas in gardens, rows of terraced houses behind small front gardens, and openings."""
    position, end = span
    while end - position > 5.0:
        if yard.chance(_OPENINGS):
            stop = min(position + yard.between(12.0, 28.0), end)
            place_opening(side, (position, stop), line, yard, cars)
            position = stop
        elif yard.chance(_ROWS):
            stop = min(position + yard.between(14.0, 45.0), end)
            garden = yard.between(0.3, 5.0)
            place_row(side, (position, stop), line + garden, TERRACE, yard)
            if garden > 1.5:
                place_border(side, (position, stop), line, yard)
            position = stop + yard.between(*_PASSAGE)
        else:
            stop = position + yard.between(13.5, 21.0)
            if stop > end:
                place_border(side, (position, end), line, yard)
                return
            place_villa(side, (position, stop), line, yard, cars)
            position = stop


def _place_avenue(side: StreetSide, span: tuple[float, float], away: float, yard: Yard) -> None:
    """Trees on the pavement."""
    position = span[0] + yard.between(0.0, yard.settings.tree_spacing)
    while position < span[1]:
        if yard.chance(0.75):
            place_tree(side.at(position, away), yard)
        position += yard.settings.tree_spacing * yard.between(0.8, 1.3)
