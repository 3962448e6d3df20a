"""DeepRING: roto-translation invariant LiDAR place recognition.

The names below are the public ones; docs/api.md tells what each is. They are imported when they
are used first, so that ``import deepring`` takes no time.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deepring.core.correlation import circular_cross_correlation as circular_cross_correlation
    from deepring.core.radon import radon as radon
    from deepring.core.spectrum import row_dft_magnitude as row_dft_magnitude
    from deepring.data.readers import open_session as open_session
    from deepring.data.session import Session as Session
    from deepring.errors import ConfigError as ConfigError
    from deepring.errors import DataError as DataError
    from deepring.errors import DeepringError as DeepringError
    from deepring.errors import FileError as FileError
    from deepring.evaluation.protocol import evaluate_method as evaluate_method
    from deepring.localization.drives.loops import LoopSettings as LoopSettings
    from deepring.localization.drives.loops import find_loops as find_loops
    from deepring.localization.map import Map as Map
    from deepring.methods.deepring import DeepRing as DeepRing
    from deepring.methods.network_file import load_network as load_network
    from deepring.methods.ring import Ring as Ring
    from deepring.methods.ring_plus_plus import RingPlusPlus as RingPlusPlus
    from deepring.methods.scan_context import ScanContext as ScanContext
    from deepring.rasters import BevRaster as BevRaster
    from deepring.rasters import Preprocessing as Preprocessing
    from deepring.search.correlation_index import CorrelationIndex as CorrelationIndex
    from deepring.search.search_settings import SearchSettings as SearchSettings
    from deepring.testing import check_method as check_method

__version__ = "0.1.0"

#: Where each public name is defined.
_MODULES = {
    "BevRaster": "deepring.rasters",
    "ConfigError": "deepring.errors",
    "CorrelationIndex": "deepring.search.correlation_index",
    "DataError": "deepring.errors",
    "DeepRing": "deepring.methods.deepring",
    "DeepringError": "deepring.errors",
    "FileError": "deepring.errors",
    "LoopSettings": "deepring.localization.drives.loops",
    "Map": "deepring.localization.map",
    "Preprocessing": "deepring.rasters",
    "Ring": "deepring.methods.ring",
    "RingPlusPlus": "deepring.methods.ring_plus_plus",
    "ScanContext": "deepring.methods.scan_context",
    "SearchSettings": "deepring.search.search_settings",
    "Session": "deepring.data.session",
    "check_method": "deepring.testing",
    "circular_cross_correlation": "deepring.core.correlation",
    "evaluate_method": "deepring.evaluation.protocol",
    "find_loops": "deepring.localization.drives.loops",
    "load_network": "deepring.methods.network_file",
    "open_session": "deepring.data.readers",
    "radon": "deepring.core.radon",
    "row_dft_magnitude": "deepring.core.spectrum",
}

__all__ = [*_MODULES, "__version__"]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'deepring' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
