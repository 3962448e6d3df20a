"""The index that looks places up as a method compares them."""

import math

from deepring.core.correlation import Form
from deepring.methods.base import Method
from deepring.methods.context_index import ContextIndex
from deepring.methods.deepring import DeepRing
from deepring.methods.disco import Disco
from deepring.methods.egonn import EgoNnGlobal
from deepring.methods.pointnetvlad import PointNetVlad
from deepring.methods.ring import Ring
from deepring.methods.ring_plus_plus import RingPlusPlus
from deepring.methods.scan_context import ScanContext
from deepring.search.compare_index import CompareIndex
from deepring.search.correlation_index import CorrelationIndex, SearchSettings
from deepring.search.hits import Index
from deepring.search.vector_index import VectorIndex


def index_for(method: Method, settings: SearchSettings | None = None) -> Index:
    """An empty index whose scores and turns are those of ``method.compare``.

    ``settings`` are those of the correlation's search. A method that is none of ours is searched
    by its own ``compare``.
    """
    match method:
        case DeepRing() if method.settings.similarity.kind == "correlation":
            half = method.settings.representation.theta_range == "half"
            period = math.pi if half else 2 * math.pi
            return CorrelationIndex(settings, period=period)
        case DeepRing():
            return VectorIndex("l2" if method.settings.similarity.kind == "l2" else "cosine")
        case Ring() if method.correlation == _PAPER:
            return CorrelationIndex(settings, cells=method.angles * method.bins)
        case RingPlusPlus() if method.correlation == _PAPER:
            channels = method.raster.shape[0]
            return CorrelationIndex(settings, cells=channels * method.angles * method.bins)
        case ScanContext():
            return ContextIndex(method.candidates)
        case Disco():
            return VectorIndex("l2", method.vectors, method.align)
        case PointNetVlad() | EgoNnGlobal():
            return VectorIndex("l2", method.vectors)
    return CompareIndex(method)


_PAPER: Form = "paper"
