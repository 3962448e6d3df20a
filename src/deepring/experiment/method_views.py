"""What a method makes of scans, for pictures: sinograms, descriptors, the score over turns."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.core.correlation import correlation_curves, magnitude_correlation_curves
from deepring.core.radon import radon
from deepring.experiment.pictures import period_of
from deepring.methods.deepring import DeepRing
from deepring.methods.method import Method, RelativePoses
from deepring.methods.ring import Ring
from deepring.rasters import BevRaster
from deepring.reports.lie import Lie, lie_of

#: Columns of a picture of a descriptor that is one vector.
_COLUMNS = 32


class MethodViews:
    """A method, and what of its scans can be drawn."""

    def __init__(self, method: Method) -> None:
        self.method = method

    @property
    def period(self) -> float:
        """Degrees that the rows of its sinograms span."""
        return period_of(self.method)

    @torch.inference_mode()
    def describe(self, raster: NDArray[Any]) -> Tensor:
        """The descriptor of one raster, with an axis for the batch."""
        return self.method.describe(torch.from_numpy(raster)[None])

    @torch.inference_mode()
    def sinogram(self, raster: NDArray[Any]) -> NDArray[np.float32] | None:
        """(θ, τ); None for a method that makes none."""
        image = torch.from_numpy(raster)[None]
        if isinstance(self.method, DeepRing) and isinstance(self.method.raster, BevRaster):
            return self.method.representation(image)[0, 0].numpy()
        if type(self.method) is Ring and isinstance(self.method.raster, BevRaster):
            values = radon(image, self.method.angles, self.method.bins)
            return values[0].numpy()
        return None

    def picture(self, descriptor: Tensor) -> NDArray[np.float32]:
        """A descriptor as rows and columns; a vector is broken into rows, the last one filled."""
        values = descriptor[0].float().cpu().numpy()
        if values.ndim >= 2:
            return np.asarray(values.reshape(-1, values.shape[-1]), dtype=np.float32)
        filled = np.full(-(-len(values) // _COLUMNS) * _COLUMNS, values.min(), dtype=np.float32)
        filled[: len(values)] = values
        return filled.reshape(-1, _COLUMNS)

    @torch.inference_mode()
    def compared(self, query: Tensor, place: Tensor) -> tuple[float, float | None]:
        """The score of a pair, and the turn of the points from place to query, radians."""
        score, turn = self.method.compare(query, place)
        told = None if turn is None or bool(torch.isnan(turn[0, 0])) else float(turn[0, 0])
        return float(score[0, 0]), told

    @torch.inference_mode()
    def curve(self, query: Tensor, place: Tensor, score: float) -> NDArray[np.float32] | None:
        """The score over turns, (θ,); None for a method that does not correlate over them."""
        method = self.method
        if isinstance(method, DeepRing) and method.settings.similarity.kind == "correlation":
            curve = correlation_curves(query, place)[0, 0]
        elif isinstance(method, Ring):
            published = method.correlation == "published"
            correlate = magnitude_correlation_curves if published else correlation_curves
            curve = correlate(query, place)[0, 0]
        else:
            return None
        top = float(curve.max())
        return (curve * (score / top if top > 0 else 1.0)).numpy()

    @torch.inference_mode()
    def lie(self, query: NDArray[Any], place: NDArray[Any], turn: float | None) -> Lie | None:
        """How the query lies on the place by the method: a whole pose, a turn alone, or None."""
        if isinstance(self.method, RelativePoses):
            pose = self.method.relative_poses(
                torch.from_numpy(query), torch.from_numpy(place)[None]
            )
            matrix = pose[0].cpu().numpy()
            if np.isfinite(matrix).all():
                return lie_of(np.linalg.inv(matrix))
        return None if turn is None else Lie(turn, None)
