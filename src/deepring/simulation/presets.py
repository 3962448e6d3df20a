"""The presets ``nclt``, ``mulran`` and ``custom``, kinds of worlds, and changes of single knobs."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from deepring.checks import one_of
from deepring.simulation.measures import MEASURES, WorldKind
from deepring.simulation.settings import Layout, SimulationSettings


def nclt(seed: int = 0) -> SimulationSettings:
    """A campus, scanned by an upside-down HDL-32E on a swaying platform, in NCLT's layout."""
    return SimulationSettings(seed=seed)


def mulran(seed: int = 0) -> SimulationSettings:
    """A city, scanned by an OS1-64 with a blind sector on a car, in MulRan's layout."""
    return SimulationSettings(
        layout="mulran",
        world="city",
        seed=seed,
        azimuths=512,
        tilt_deg=0.7,
        blind_width_deg=70.0,
        reversed_share=0.2,
        scan_spacing=3.0,
        speed=8.0,
        **MEASURES["city"],
    )


def custom(seed: int = 0) -> SimulationSettings:
    """A campus, scanned by any of `SENSORS` on a car, in the layout of docs/custom_data.md."""
    return SimulationSettings(
        layout="custom",
        seed=seed,
        sensor="os1_64",
        sensor_height=1.8,
        azimuths=512,
        range_noise=None,
        tilt_deg=1.0,
        speed=6.0,
    )


def preset(name: str, seed: int = 0) -> SimulationSettings:
    """The preset called ``name``: nclt, mulran or custom. Raises ConfigError otherwise."""
    one_of("preset", name, Layout)
    return {"nclt": nclt, "mulran": mulran, "custom": custom}[name](seed)


def in_world(settings: SimulationSettings, world: object) -> SimulationSettings:
    """``settings`` in a world of another kind, with the measures of such worlds (`MEASURES`).

    Raises ConfigError for an unknown kind.
    """
    return replace(settings, **_in_kind(world))


def _in_kind(world: object) -> dict[str, Any]:
    """The settings that make a world one of a kind."""
    one_of("world", world, WorldKind)
    usual: dict[str, Any] = {f.name: f.default for f in fields(SimulationSettings)}
    measures = {name: usual[name] for kind in MEASURES.values() for name in kind}
    return measures | MEASURES[world] | {"world": world}  # type: ignore[index]


def tiny(name: str, seed: int = 0, world: WorldKind | None = None) -> SimulationSettings:
    """A preset shrunk for tests: a loop of four streets in each region, coarse scans."""
    whole = preset(name, seed)
    return replace(
        whole if world is None else in_world(whole, world),
        block=45.0,
        train_columns=2,
        test_columns=2,
        rows=2,
        crossing_jitter=3.0,
        azimuths=240 if name == "nclt" else 128,
        scan_spacing=5.0,
    )


def with_knobs(settings: SimulationSettings, knobs: Mapping[str, object]) -> SimulationSettings:
    """A copy of ``settings`` with changes. Raises ConfigError for an unknown name.

    The knob ``world`` brings the measures of its kind (`in_world`); other knobs go before those.
    """
    names = [f.name for f in fields(settings)]
    for name in knobs:
        one_of("knob", name, names)
    kind = _in_kind(knobs["world"]) if "world" in knobs else {}
    return replace(settings, **(kind | dict(knobs)))
