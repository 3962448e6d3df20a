"""Images, poses and names of the places of a map."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.core.rigid import yaw_of
from deepring.data.packed_rasters import pack, unpack
from deepring.errors import DataError
from deepring.localization.given import nearly_rigid
from deepring.rasters import BevRaster
from deepring.search.block_store import BlockStore


class PlaceStore:
    """Places in the order in which they were added. Adding one does not copy the others."""

    def __init__(self, raster: BevRaster) -> None:
        self.raster = raster
        self.names: list[str] = []
        self._rows = BlockStore()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def image_bytes(self) -> int:
        """Bytes of one packed image."""
        return -(-(self.raster.cells**2) // 8)

    @property
    def poses(self) -> NDArray[np.float64]:
        """Poses (n, 4, 4), world <- scan: a copy of all of them."""
        return self.tensors()["poses"].numpy()

    @property
    def positions(self) -> NDArray[np.float64]:
        """World positions (n, 2), metres: a copy of all of them."""
        return self.poses[:, :2, 3]

    def add(
        self, images: NDArray[np.bool_], poses: NDArray[np.float64], names: Sequence[str]
    ) -> None:
        """Add k places: images (k, n, n), poses (k, 4, 4) world <- scan, and names.

        Raises DataError unless there are k of each, and for poses that are not finite.
        """
        packed = [pack(image, self.raster) for image in images]
        rows = torch.from_numpy(np.stack(packed)) if packed else torch.empty(0, self.image_bytes)
        self._append(rows.byte(), torch.from_numpy(np.array(poses, dtype=np.float64)), names)

    def mark(self) -> tuple[Any, ...]:
        """The present places, to which `rewind` goes back."""
        return self._rows.mark(), len(self.names)

    def rewind(self, mark: tuple[Any, ...]) -> None:
        """Drop the places added since `mark`."""
        rows, count = mark
        self._rows.rewind(rows)
        del self.names[count:]

    def images(self, places: Tensor) -> Tensor:
        """Images (k, n, n) uint8, 0 or 1, of places (k,)."""
        (packed,) = self._rows.take(places, "images")
        return torch.from_numpy(unpack(packed.numpy(), self.raster))

    def planar_poses(self, places: Tensor) -> Tensor:
        """x, y and yaw of places (k,) in the world: (k, 3) float64, metres and radians."""
        (poses,) = self._rows.take(places, "poses")
        return torch.column_stack([poses[:, :2, 3], torch.from_numpy(yaw_of(poses.numpy()))])

    def tensors(self) -> dict[str, Tensor]:
        """Packed images (n, bytes) uint8 and poses (n, 4, 4) float64, for a file."""
        blocks = self._rows.blocks()
        empty = {
            "images": torch.empty(0, self.image_bytes, dtype=torch.uint8),
            "poses": torch.empty(0, 4, 4, dtype=torch.float64),
        }
        return {
            k: torch.cat([start, *(block[k] for block in blocks)]) for k, start in empty.items()
        }

    def restore(self, images: Tensor, poses: Tensor, names: Sequence[str]) -> None:
        """Take the names, and without a copy what `tensors` gave, which may be memory-mapped.

        Raises DataError as `add` does, and for images of another size and poses that are not
        rigid.
        """
        bad = int((~nearly_rigid(poses.numpy())).sum()) if poses.shape[1:] == (4, 4) else 0
        if bad or not bool((poses[:, 3:] == torch.eye(4, dtype=poses.dtype)[3]).all()):
            raise DataError(
                f"poses: {bad or 'some'} of {len(poses)} are not rigid; expected world <- scan "
                "transforms: a rotation and a translation"
            )
        self._rows, self.names = BlockStore(), []
        self._append(images, poses, names, attach=True)

    def _append(
        self, images: Tensor, poses: Tensor, names: Sequence[str], *, attach: bool = False
    ) -> None:
        n = len(names)
        if images.shape != (n, self.image_bytes) or poses.shape != (n, 4, 4):
            raise DataError(
                f"places: {n} names, images {tuple(images.shape)} and poses {tuple(poses.shape)}; "
                f"expected ({n}, {self.image_bytes}) and ({n}, 4, 4)"
            )
        if not bool(torch.isfinite(poses).all()):
            raise DataError("places: poses that are not finite; expected world <- scan transforms")
        if n:
            rows = {"images": images, "poses": poses}
            (self._rows.attach if attach else self._rows.add)(rows)
            self.names.extend(names)
