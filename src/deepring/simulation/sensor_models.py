"""LiDARs that can be simulated, as their data sheets describe them."""

from dataclasses import dataclass

import numpy as np

from deepring.simulation.rosette import Rosette

#: Firing order aside, the elevations (degrees) of the VLP-32C's lasers.
_VLP32C = (
    *(-25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333),
    *(-3.0, -2.667, -2.333, -2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667),
    *(1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0, 10.333, 15.0),
)


@dataclass(frozen=True)
class SensorModel:
    """What a data sheet says about a LiDAR. Metres, degrees.

    ``beams`` are elevations, ascending, of a LiDAR that spins, and ``columns`` is their number per
    revolution at 10 Hz. One that does not spin has a ``rosette`` instead. Points are measured from
    ``blind`` to ``range`` with the standard deviation ``noise``. ``sheet`` names the source.
    """

    title: str
    beams: tuple[float, ...]
    columns: int
    blind: float
    range: float
    noise: float
    sheet: str
    starts_anywhere: bool = True  # an Ouster's columns are at fixed angles of its encoder
    rosette: Rosette | None = None


def _even(low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(np.linspace(low, high, count).tolist())


#: By the name that the knobs ``sensor`` and ``query_sensor`` take. Ranges are those of surfaces
#: that reflect 80 %; where a sheet states an accuracy of ±x, the noise is x / 2 (two deviations).
SENSORS: dict[str, SensorModel] = {
    "vlp16": SensorModel(
        title="Velodyne VLP-16",
        beams=_even(-15.0, 15.0, 16),
        columns=1800,
        blind=0.5,
        range=100.0,
        noise=0.015,
        sheet="VLP-16 User Manual 63-9243: ±15° in steps of 2°, 100 m, ±3 cm",
    ),
    "vlp32c": SensorModel(
        title="Velodyne VLP-32C",
        beams=_VLP32C,
        columns=1800,
        blind=0.5,
        range=200.0,
        noise=0.015,
        sheet="VLP-32C User Manual 63-9325: 25° down to 15° up, dense around 0°, 200 m, ±3 cm",
    ),
    "hdl32e": SensorModel(
        title="Velodyne HDL-32E",
        beams=_even(-30.67, 10.67, 32),
        columns=2170,
        blind=0.9,
        range=100.0,
        noise=0.01,
        sheet="HDL-32E User's Manual 63-9113: 30.67° down to 10.67° up, 100 m, ±2 cm",
    ),
    "hdl64e": SensorModel(
        title="Velodyne HDL-64E",
        beams=(*_even(-24.33, -8.83, 32), *_even(-8.33, 2.0, 32)),
        columns=2083,
        blind=0.9,
        range=120.0,
        noise=0.01,
        sheet="HDL-64E S2 User's Manual: two blocks of 32 lasers, in steps of 1/2° from 24.33° "
        "down and of 1/3° up to 2°, 120 m, ±2 cm",
    ),
    "os0_128": SensorModel(
        title="Ouster OS0-128",
        beams=_even(-45.0, 45.0, 128),
        columns=1024,
        blind=0.3,
        range=50.0,
        noise=0.015,
        sheet="OS0 data sheet, revision C/D: 90°, 50 m, deviation 1.5 to 5 cm",
        starts_anywhere=False,
    ),
    "os1_64": SensorModel(
        title="Ouster OS1-64",
        beams=_even(-16.6, 16.6, 64),
        columns=1024,
        blind=0.8,
        range=120.0,
        noise=0.03,
        sheet="OS1 data sheet of the first generation: 33.2°, 120 m, deviation 1.5 to 10 cm",
        starts_anywhere=False,
    ),
    "os2_128": SensorModel(
        title="Ouster OS2-128",
        beams=_even(-11.25, 11.25, 128),
        columns=1024,
        blind=1.0,
        range=210.0,
        noise=0.025,
        sheet="OS2 data sheet, revision C/D: 22.5°, 210 m, deviation 2.5 to 8 cm",
        starts_anywhere=False,
    ),
    "livox_avia": SensorModel(
        title="Livox Avia",
        beams=(),
        columns=0,
        blind=1.0,
        range=190.0,
        noise=0.02,
        sheet="Avia User Manual v1.0: 70.4° x 77.2° (non-repetitive; 4.5° high if repetitive), "
        "240 000 points/s, 190 m at 10 %, deviation 2 cm at 20 m",
        rosette=Rosette(width=70.4, height=77.2, points=24_000, lasers=6, spread=4.5),
    ),
    "livox_hap": SensorModel(
        title="Livox HAP",
        beams=(),
        columns=0,
        blind=0.5,
        range=150.0,
        noise=0.02,
        sheet="HAP (TX) User Manual v1.0: 120° x 25°, 452 000 points/s, 150 m at 10 %, blind "
        "below 0.5 m, deviation 2 cm at 20 m",
        rosette=Rosette(width=120.0, height=25.0, points=45_200, lasers=6, spread=2.0),
    ),
}
