"""Small things on the pavement: bins, signs, cabinets, bollards, bus shelters."""

from deepring.simulation.furnish import scatter
from deepring.simulation.shapes import PointClass
from deepring.simulation.yard import StreetSide, Yard


def place_kerbside(side: StreetSide, away: float, yard: Yard) -> None:
    """Scatter small things ``away`` metres from the street's middle, and signs at the kerb."""
    beyond = away - yard.settings.corridor
    for _ in range(int(yard.rng.poisson(side.length / 12.0))):
        size = (yard.between(0.4, 1.6), yard.between(0.3, 0.7), yard.between(0.8, 1.5))
        scatter(side, size, (max(beyond - 0.6, 0.0), beyond + 0.4), PointClass.OTHER, yard)
    for _ in range(int(yard.rng.poisson(side.length / 30.0))):
        place = side.at(yard.between(0.0, side.length), away - 0.3)
        yard.post(place, yard.between(0.04, 0.08), yard.between(2.0, 3.2), PointClass.POLE)
    if yard.chance(side.length / 400.0):
        _place_shelter(side, away, yard)
    if yard.chance(side.length / 250.0):
        begin = yard.between(0.0, side.length)
        for k in range(int(yard.rng.integers(3, 9))):
            yard.post(side.at(begin + 1.8 * k, away - 0.4), 0.08, 0.95, PointClass.POLE)


def _place_shelter(side: StreetSide, away: float, yard: Yard) -> None:
    """A bus shelter: a back wall, two ends and a roof."""
    along, back = yard.between(0.2, 0.8) * side.length, away + 0.7
    for offset, size in (
        (0.0, (3.6, 0.08, 2.4)),
        (-1.8, (0.08, 1.3, 2.4)),
        (1.8, (0.08, 1.3, 2.4)),
    ):
        place = side.at(along + offset, back - (0.65 if offset else 0.0))
        yard.box(place, size, side.yaw, PointClass.STRUCTURE, 0.4)
    yard.slab(side.at(along, back - 0.7), (4.0, 1.5), side.yaw, (2.4, 2.55), PointClass.STRUCTURE)
