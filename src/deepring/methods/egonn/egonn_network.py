"""EgoNN: a sparse convolutional network over cylindrical voxels of a scan.

Source: Komorowski et al., "EgoNN: Egocentric Neural Network for Point Cloud Based 6DoF
Relocalization at the City Scale", RA-L 2021, Sec. III; sizes as in its repository jac99/Egonn.
"""

import math
from collections.abc import Mapping, Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.nn import sparse
from deepring.nn.sparse import PointNorm, SparseTensor, SubmanifoldConv
from deepring.nn.sparse_grid import Grid
from deepring.rasters.voxels import PADDING, sectors_of

Voxels = Sequence[Shaped[Tensor, "..."]] | Shaped[Tensor, "..."]
"""A list of (m, 3) integer (θ, r, z), one a scan, or (b, m, 3) filled up with rows of PADDING."""

WIDTHS = (32, 64, 64, 128, 128, 128, 128)


def voxel_grid(voxels: Voxels, wrap: int | None = None) -> Grid:
    """The grid of a batch of scans; DataError where a scan is empty or not (m, 3) integers."""
    if isinstance(voxels, Tensor):
        filled = voxels[..., 0] != PADDING
        voxels = [scan[rows] for scan, rows in zip(voxels, filled, strict=True)]
    for k, scan in enumerate(voxels):
        if scan.is_floating_point() or scan.shape[1:] != (3,) or not len(scan):
            raise DataError(
                f"voxels: scan {k} is {tuple(scan.shape)} {scan.dtype}, expected (m, 3) integers "
                "(θ, r, z), at least one; leave empty scans out"
            )
    if not len(voxels):
        raise DataError("voxels: no scan, expected one or more")
    sites = torch.cat([F.pad(scan.long(), (1, 0), value=k) for k, scan in enumerate(voxels)])
    return Grid(sites, wrap=wrap, batch=len(voxels))


def relu(x: SparseTensor) -> SparseTensor:
    """Features below 0 become 0."""
    return x.put(F.relu(x.features))


class EfficientChannelAttention(nn.Module):
    """Scales each channel of a scan by a weight in (0, 1) from its neighbouring channels' means.

    Source: Wang et al., "ECA-Net", CVPR 2020; the kernel grows with log2 of the channels.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        kernel = int((math.log2(channels) + 1) / 2)
        kernel += 1 - kernel % 2
        self.conv = nn.Conv1d(1, 1, kernel, padding=kernel // 2, bias=False)

    def weights(self, x: SparseTensor) -> Float[Tensor, "batch channel"]:
        """(b, channels) in (0, 1)."""
        means = torch.stack([scan.mean(dim=0) for scan in x.scans()])
        return self.conv(means[:, None])[:, 0].sigmoid()

    def forward(self, x: SparseTensor) -> SparseTensor:
        """The same sites, scaled."""
        weights = self.weights(x)
        # Scan by scan: a gather's gradient would be a slow scatter of all sites onto few rows.
        return x.put(torch.cat([s * w for s, w in zip(x.scans(), weights, strict=True)]))


class ResidualBlock(nn.Module):
    """Two 3x3x3 convolutions and channel attention beside a shortcut, all on the same sites."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.conv1 = SubmanifoldConv(in_channels, out_channels)
        self.norm1 = PointNorm(out_channels)
        self.conv2 = SubmanifoldConv(out_channels, out_channels)
        self.norm2 = PointNorm(out_channels)
        self.attention = EfficientChannelAttention(out_channels)
        self.shortcut: nn.Module = nn.Identity()
        if in_channels != out_channels:
            self.shortcut = nn.Sequential(
                SubmanifoldConv(in_channels, out_channels, 1), PointNorm(out_channels)
            )

    def forward(self, x: SparseTensor) -> SparseTensor:
        """(n, in) -> (n, out)."""
        y = relu(self.norm1(self.conv1(x)))
        y = self.attention(self.norm2(self.conv2(y)))
        return relu(x.put(y.features + self.shortcut(x).features))


class Trunk(nn.Module):
    """Bottom-up: a 5x5x5 convolution, then at each level a strided convolution and a block."""

    def __init__(self, in_channels: int = 1, widths: Sequence[int] = WIDTHS) -> None:
        super().__init__()
        checks.widths("egonn.widths", widths)
        sources = [widths[0], *widths[:-1]]
        self.stem = nn.Sequential(SubmanifoldConv(in_channels, widths[0], 5), PointNorm(widths[0]))
        self.down = nn.ModuleList(
            nn.Sequential(sparse.StridedConv(a, a), PointNorm(a)) for a in sources
        )
        self.blocks = nn.ModuleList(
            ResidualBlock(a, b) for a, b in zip(sources, widths, strict=True)
        )
        for module in self.modules():
            if isinstance(module, (SubmanifoldConv, sparse.StridedConv)):
                offsets, _, channels = module.weight.shape
                nn.init.normal_(module.weight, std=math.sqrt(2 / (offsets * channels)))

    def forward(self, x: SparseTensor) -> dict[int, SparseTensor]:
        """Feature maps by level; level k has stride 2 ** k."""
        x = relu(self.stem(x))
        levels = {}
        for k, (down, block) in enumerate(zip(self.down, self.blocks, strict=True), start=1):
            x = levels[k] = block(relu(down(x)))
        return levels


class TopDown(nn.Module):
    """Feature pyramid: from the highest level down to the lowest, joined by 1x1 laterals."""

    def __init__(self, levels: Sequence[int], widths: Sequence[int], channels: int) -> None:
        super().__init__()
        low, high = self.low, self.high = min(levels, default=0), max(levels, default=0)
        if list(levels) != list(range(low, high + 1)) or not 1 <= low <= high <= len(widths):
            raise ConfigError(
                f"egonn.levels: {list(levels)}, expected consecutive ones of 1 to {len(widths)}"
            )
        self.lateral = nn.ModuleDict(
            {str(k): SubmanifoldConv(widths[k - 1], channels, 1) for k in levels}
        )
        self.up = nn.ModuleDict(
            {str(k): sparse.TransposedConv(channels, channels) for k in levels[1:]}
        )

    def forward(self, levels: Mapping[int, SparseTensor]) -> SparseTensor:
        """(n, channels) on the sites of the lowest level."""
        y = self.lateral[str(self.high)](levels[self.high])
        for k in range(self.high - 1, self.low - 1, -1):
            y = self.up[str(k + 1)](y, levels[k].grid)
            y = y.put(y.features + self.lateral[str(k)](levels[k]).features)
        return y


class GeM(nn.Module):
    """Generalised mean over the sites of each scan, mean(max(x, eps)^p)^(1/p), with a learned p.

    Source: Radenović et al., "Fine-tuning CNN Image Retrieval with No Human Annotation",
    TPAMI 2019, Eq. 4.
    """

    def __init__(self, p: float = 3.0, eps: float = 1e-6) -> None:
        super().__init__()
        self.p = nn.Parameter(torch.tensor([p]))
        self.eps = eps

    def forward(self, x: SparseTensor) -> Float[Tensor, "batch value"]:
        """(n, c) of b scans -> (b, c)."""
        powers = x.put(x.features.clamp(min=self.eps).pow(self.p))
        return torch.stack([scan.mean(dim=0) for scan in powers.scans()]).pow(1 / self.p)


def decoder(in_channels: int, middle: int, out_channels: int) -> nn.Sequential:
    """Linear, ReLU, linear on each site."""
    return nn.Sequential(nn.Linear(in_channels, middle), nn.ReLU(), nn.Linear(middle, out_channels))


class GlobalHead(nn.Module):
    """Levels of the trunk -> descriptors (b, size), not normalised, compared by their distance."""

    def __init__(
        self,
        widths: Sequence[int] = WIDTHS,
        levels: Sequence[int] = (5, 6, 7),
        channels: int = 128,
        size: int = 256,
    ) -> None:
        super().__init__()
        self.pyramid = TopDown(levels, widths, channels)
        self.decoder = decoder(channels, (channels + size) // 2, size)
        self.pool = GeM()
        self.size = size

    def forward(self, levels: Mapping[int, SparseTensor]) -> Float[Tensor, "batch value"]:
        """(b, size) descriptors."""
        x = self.pyramid(levels)
        return self.pool(x.put(self.decoder(x.features)))


class EgoNN(nn.Module):
    """Scans as cylindrical voxels -> global descriptors (b, 256).

    The descriptor is not normalised, as in the paper's configuration; places are compared by its
    Euclidean distance. The original's second head, of local keypoints, is left out: place
    recognition does not need it.

    Args:
        steps: degrees, ring and height of the voxels, as given to `cylindrical_voxels`.
        widths: channels of each level of the trunk.
        global_levels: consecutive levels that the head joins.
        close_theta: whether θ wraps. EgoNN's does not, which is the default; where it does, the
            number of sectors must be a multiple of 2 ** levels (384 for the seven levels).
    """

    def __init__(
        self,
        *,
        steps: tuple[float, float, float] = (1.0, 0.3, 0.2),
        widths: Sequence[int] = WIDTHS,
        global_levels: Sequence[int] = (5, 6, 7),
        close_theta: bool = False,
    ) -> None:
        super().__init__()
        sectors = sectors_of(steps[0])
        if close_theta and sectors % 2 ** len(widths):
            raise ConfigError(
                f"egonn.steps: {steps[0]!r} degrees are {sectors} sectors; expected a multiple of "
                f"{2 ** len(widths)} to close θ over {len(widths)} levels"
            )
        self.wrap = sectors if close_theta else None
        self.trunk = Trunk(1, widths)
        self.global_head = GlobalHead(widths, global_levels)

    def encode(self, voxels: Voxels) -> dict[int, SparseTensor]:
        """The trunk's feature maps; every voxel enters as a 1. See `voxel_grid` for errors."""
        grid = voxel_grid(voxels, self.wrap)
        ones = next(self.parameters()).new_ones(len(grid), 1)
        return self.trunk(SparseTensor(ones, grid))

    def forward(self, voxels: Voxels) -> Float[Tensor, "batch value"]:
        """(b, 256) descriptors of b scans, not normalised."""
        if not len(voxels):
            return next(self.parameters()).new_empty(0, self.global_head.size)
        return self.global_head(self.encode(voxels))
