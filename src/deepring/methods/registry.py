"""The names of methods: what checkpoints, maps and exported descriptors call a method by.

A file names its method and never causes an import: the name has to be registered, here or by
`register_method`, or the caller gives the class.
"""

import importlib

from deepring.errors import ConfigError
from deepring.text import shown

_METHODS: dict[str, str | type] = {
    "deepring": "deepring.methods.deepring.DeepRing",
    "ring": "deepring.methods.ring.Ring",
    "ring_plus_plus": "deepring.methods.ring_plus_plus.RingPlusPlus",
    "scan_context": "deepring.methods.scan_context.ScanContext",
    "fast_histogram": "deepring.methods.fast_histogram.FastHistogram",
    "m2dp": "deepring.methods.m2dp.M2dp",
    "polar_context": "deepring.methods.scan_context_plus_plus.PolarContext",
    "cart_context": "deepring.methods.scan_context_plus_plus.CartContext",
    "lidar_iris": "deepring.methods.lidar_iris.LidarIris",
    "ssc": "deepring.methods.ssc.Ssc",
    "disco": "deepring.methods.disco.Disco",
    "pointnetvlad": "deepring.methods.pointnetvlad.PointNetVlad",
    "lpdnet": "deepring.methods.lpdnet.LpdNet",
    "egonn": "deepring.methods.egonn.EgoNnGlobal",
    "locnet": "deepring.methods.locnet.LocNet",
    "overlapnet": "deepring.methods.overlapnet.OverlapNet",
    "rinet": "deepring.methods.rinet.RINet",
    "lcdnet": "deepring.methods.lcdnet.LcdNet",
    "dh3d": "deepring.methods.dh3d.Dh3d",
    "locus": "deepring.methods.locus.Locus",
}
"""Classes, or their dotted paths, which are imported when they are asked for."""


def packaged_methods() -> dict[str, str]:
    """The package's own methods: name to dotted path of the class, none of them imported."""
    return {name: path for name, path in _METHODS.items() if isinstance(path, str)}


def registered_methods() -> tuple[str, ...]:
    """The names of all registered methods."""
    return tuple(_METHODS)


def register_method(name: str, cls: type) -> None:
    """Let files call the class ``name``, such as 'mine'.

    Raises ConfigError for a name that is no Python identifier, or that another class has.
    """
    if not isinstance(cls, type):
        raise ConfigError(f"cls: a {type(cls).__name__}, expected the class of a method")
    if not isinstance(name, str) or not name.isidentifier():
        raise ConfigError(f"name: {name!r}, expected letters, digits and underscores, as 'mine'")
    if class_path(cls) != _path_of(_METHODS.get(name, cls)):
        raise ConfigError(
            f"name: {name!r} is registered for {_path_of(_METHODS[name])}, expected a free name "
            f"for {class_path(cls)}; choose another"
        )
    _METHODS[name] = cls


def is_packaged(cls: type) -> bool:
    """Whether the class is a method of this package, and not a user's own."""
    return class_path(cls) in packaged_methods().values()


def method_name(cls: type) -> str:
    """The name of the class in files: its registered name, or else its dotted path."""
    path = class_path(cls)
    return next((name for name, known in _METHODS.items() if _path_of(known) == path), path)


def method_class(name: str, own_class: str | type | None = None) -> type:
    """The class of a name that a file holds.

    Args:
        name: as `method_name` gives it.
        own_class: the user's class, or its dotted path, for a name that is not registered. It comes
            from the user, never from a file.

    Raises:
        ConfigError: a name that is not registered and is not that of ``own_class``.
    """
    known = _METHODS.get(name)
    if known is not None:
        return class_at(known) if isinstance(known, str) else known
    cls = class_at(own_class) if isinstance(own_class, str) else own_class
    if cls is not None and method_name(cls) == name:
        return cls
    if name in map(_path_of, _METHODS.values()):  # as files said before methods had names
        raise ConfigError(
            f"method: {name!r} is how an earlier version of deepring named it; expected one of "
            f"{', '.join(_METHODS)}; train or export it again with this version"
        )
    given = "" if cls is None else f", and the class given is {class_path(cls)}"
    raise ConfigError(
        f"method: {shown(name, 80)} is not registered{given}; expected one of "
        f"{', '.join(_METHODS)}, or the class of that name: register_method(name, cls) in Python, "
        "method._target_ in a config, or its dotted path as `own_class`"
    )


def class_at(path: str) -> type:
    """The class at a dotted path that the user gave, in a config or as an option.

    Raises ConfigError where there is none.
    """
    module, _, name = path.rpartition(".")
    try:
        cls = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError):
        cls = None
    if not isinstance(cls, type):
        raise ConfigError(
            f"method: {path!r} cannot be imported, expected the dotted path of a method's class, "
            "such as deepring.methods.deepring.DeepRing; a module of your own has to be on the "
            "Python path"
        )
    return cls


def class_path(cls: type) -> str:
    """'module.Class', as a config's ``_target_`` names it."""
    return f"{cls.__module__}.{cls.__qualname__}"


def _path_of(known: str | type) -> str:
    return known if isinstance(known, str) else class_path(known)
