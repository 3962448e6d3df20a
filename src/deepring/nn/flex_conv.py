"""FlexConv: a convolution over the neighbours of a point, with weights linear in their offsets.

Source: Groh, Wieschollek, Lensch: Flex-Convolution (ACCV 2018); DH3D (Du et al., ECCV 2020).
"""

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from deepring import checks
from deepring.nn.neighbourhoods import gathered

#: Weights of offsets begin so much smaller than those of features: offsets are in metres.
_OFFSET_START = 0.1


class FlexConv(nn.Module):
    """y_i = β + Σ_k Σ_c f_kc (B_c + Θ_c · (p_k - p_i)), k the neighbours of point i.

    It is one linear map of four moments of each channel, Σ f, Σ Δx f, Σ Δy f and Σ Δz f. A shift of
    all points changes nothing, nor does the order of a point's neighbours.

    Args:
        channels: of the features, c.
        width: of the output; B is (c, width), Θ (c, width, 3), β (width,).
    """

    def __init__(self, channels: int, width: int) -> None:
        super().__init__()
        self.channels = checks.count("flex_conv.channels", channels, most=8192)
        self.linear = nn.Linear(4 * channels, checks.count("flex_conv.width", width, most=8192))
        with torch.no_grad():
            self.linear.weight[:, channels:] *= _OFFSET_START

    def forward(
        self,
        features: Float[Tensor, "batch n channel"],
        points: Float[Tensor, "batch n 3"],
        near: Int64[Tensor, "batch n k"],
    ) -> Float[Tensor, "batch n width"]:
        """Features (b, n, width) of the points.

        Args:
            features: (b, n, c).
            points: (b, n, 3) metres.
            near: (b, n, k) numbers of each point's neighbours.
        """
        shape = near.shape
        around = gathered(features, near.flatten(1)).view(*shape, self.channels)
        offsets = gathered(points, near.flatten(1)).view(*shape, 3) - points[:, :, None]
        factors = torch.cat([torch.ones_like(offsets[..., :1]), offsets], dim=-1)
        moments = factors.transpose(2, 3).to(around.dtype) @ around  # (b, n, 4, c)
        mixed: Tensor = self.linear(moments.flatten(2))
        return mixed
