"""Short codes of places, which are compared without a search over rotations.

The correlation over rotations α of two descriptors is Σ_k exp(ikα) c_k, c_k = Σ_ω Q(k, ω) conj
D(k, ω) over θ-frequencies k. Its maximum is at most Σ_k |c_k|, which is invariant to rotation. A
code holds the lowest frequencies and the first principal components over ω of each, as int8; the
bound computed from codes ranks places well enough that exact correlation of the best few hundred
finds the best of all.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Float32, Int8
from torch import Tensor

from deepring.checks import count
from deepring.core.correlation import theta_spectrum
from deepring.errors import DataError

#: Rows and columns of a descriptor, and of what is made of it.
LONGEST = 8192

#: Descriptors that a code is fitted to.
ENOUGH = 1024


@dataclass(frozen=True)
class CodeSettings:
    """Size of a code: 2 · frequencies · components bytes."""

    frequencies: int = 10
    components: int = 16

    def __post_init__(self) -> None:
        for name in ("frequencies", "components"):
            count(f"search.code.{name}", getattr(self, name), most=LONGEST)


class Code(NamedTuple):
    """An encoder of descriptors as codes."""

    basis: Float32[Tensor, "omega p"]
    """(ω, p) orthonormal float32, principal directions of the rows of descriptors."""
    step: Float32[Tensor, "k p"]
    """(k, p) float32: value of one int8 step."""
    rows: int
    """Rows θ of the descriptors."""

    def encode(
        self, descriptors: Float[Tensor, "n theta omega"]
    ) -> Int8[Tensor, "frequency component 2 n"]:
        """Codes (k, p, 2, n) int8 of descriptors (n, θ, ω), real and imaginary parts."""
        scaled = self._project(descriptors) / self.step[..., None]
        return scaled.round().clamp(-127, 127).char().permute(1, 2, 3, 0).contiguous()

    def queries(
        self, descriptors: Float[Tensor, "q theta omega"]
    ) -> Float32[Tensor, "q frequency component 2"]:
        """Queries (q, k, p, 2) float32 for `code_scores`."""
        # Frequencies except 0 and θ / 2 occur twice; the inverse DFT divides by θ.
        weight = torch.full((len(self.step), 1, 1), 2.0 / self.rows, device=descriptors.device)
        weight[0] = 1.0 / self.rows
        if 2 * (len(weight) - 1) == self.rows:
            weight[-1] = 1.0 / self.rows
        return (self._project(descriptors) * self.step[..., None] * weight).contiguous()

    def _project(
        self, descriptors: Float[Tensor, "n theta omega"]
    ) -> Float32[Tensor, "n frequency component 2"]:
        spectrum = theta_spectrum(descriptors)[:, : len(self.step)]
        parts = torch.view_as_real(spectrum)  # (n, k, ω, 2)
        return torch.einsum("nkwc,wp->nkpc", parts, self.basis)


def expect_shape(shape: tuple[int, int] | None) -> tuple[int, int] | None:
    """The shape (θ, ω) of descriptors, where one is stated.

    Raises ConfigError for lengths that no index holds.
    """
    for length in shape or ():
        count("shape", length, most=LONGEST)
    return shape


def expect_code(code: Code, shape: tuple[int, int], settings: CodeSettings) -> Code:
    """The code. Raises DataError unless it is one of ``settings`` for descriptors of ``shape``."""
    rows, columns = shape
    frequencies = min(settings.frequencies, rows // 2 + 1)
    components = min(settings.components, columns)
    expected = ((columns, components), (frequencies, components))
    shapes = (tuple(code.basis.shape), tuple(code.step.shape))
    if shapes != expected or code.rows != rows:
        raise DataError(
            f"code: basis and step of shapes {shapes}; expected {expected}, for descriptors of "
            f"{rows} x {columns} and search.code {settings.frequencies} x {settings.components}"
        )
    return code


def fit_code(descriptors: Float[Tensor, "n theta omega"], settings: CodeSettings) -> Code:
    """A code fitted to descriptors (n, θ, ω); smaller than the settings if θ or ω is small.

    Of many descriptors `ENOUGH` are taken, evenly: more do not make it better.
    """
    descriptors = descriptors[:: max(1, len(descriptors) // ENOUGH)]
    rows, columns = descriptors.shape[1:]
    frequencies = min(settings.frequencies, rows // 2 + 1)
    components = min(settings.components, columns)
    samples = descriptors.flatten(0, 1).double()
    _, directions = torch.linalg.eigh(samples.T @ samples)  # ascending
    basis = directions.flip(-1)[:, :components].float().contiguous()
    unscaled = Code(basis, torch.ones(frequencies, components, device=basis.device), rows)
    magnitudes = unscaled._project(descriptors).abs().permute(1, 2, 0, 3).flatten(2)
    # One value in a thousand is clipped, so that outliers do not reduce the precision of the rest.
    largest = magnitudes.sort(dim=-1).values[..., int(0.999 * (magnitudes.shape[-1] - 1))]
    return Code(basis, largest.clamp_min(1e-30) / 127, rows)


def code_scores(
    queries: Float32[Tensor, "q frequency component 2"],
    codes: Int8[Tensor, "frequency component 2 n"],
    number: int | None = None,
) -> Float32[Tensor, "q _"]:
    """Σ_k |c_k| (q, n) float32 of queries (q, k, p, 2) float32 with codes (k, p, 2, n) int8.

    ``number`` limits them to the first codes."""
    number = codes.shape[-1] if number is None else number
    if queries.device.type == "cpu":
        from deepring.search import _correlation_kernels as _kernels

        out = torch.empty(len(queries), number)
        _kernels.code_scores(queries.numpy(), codes.contiguous().numpy(), out.numpy())
        return out
    complex_queries = torch.view_as_complex(queries).transpose(0, 1)
    parts = codes[..., :number].float()
    return torch.bmm(complex_queries, torch.complex(parts[:, :, 0], -parts[:, :, 1])).abs().sum(0)
