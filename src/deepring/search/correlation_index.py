"""Search by circular cross-correlation of all places, or of the best by a short code."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from deepring.checks import count
from deepring.core.correlation import shift_to_turn
from deepring.errors import ConfigError, DataError, FileError
from deepring.io.sealed import open_sealed, write_sealed
from deepring.search import exact
from deepring.search.block_store import BlockStore, axis_of
from deepring.search.code import (
    Code,
    code_scores,
    expect_code,
    fit_code,
)
from deepring.search.given import given_descriptors
from deepring.search.hits import Best, Hits
from deepring.search.index_file import FORMAT, IndexHeader
from deepring.search.search_settings import SearchSettings
from deepring.search.shards import INDEX, Shard, expect_block, read_shards, write_shard
from deepring.search.spectra import Spectra, decode, encode, padded_spectra

#: Places up to which a code is fitted anew as their number grows, so that a map built scan by scan
#: has as good a code as one built at once: one fitted to a single scan ranks clearly worse.
REFIT_BELOW = 1000


class CorrelationIndex:
    """Places by the θ-spectra of their descriptors (n, θ, ω), searched by Eq. 8.

    Args:
        settings: precision, codes and candidates.
        period: range of θ, radians.
        cells: divisor of scores.
        device: device that stores and searches the places.
    """

    def __init__(
        self,
        settings: SearchSettings | None = None,
        *,
        period: float = 2 * math.pi,
        cells: float = 1.0,
        device: torch.device | str = "cpu",
    ) -> None:
        self.settings = SearchSettings() if settings is None else settings
        self.period, self.cells, self.device = period, cells, torch.device(device)
        self.places = BlockStore()
        self.code: Code | None = None
        self._fitted = 0  # places that the code was fitted to
        self.shape: tuple[int, int] | None = None
        self._folder: Path | None = None
        self._shards: tuple[Shard, ...] = ()  # the first blocks, stored in that folder

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Any) -> None:
        """Add places. The first ones determine the code of all, see `REFIT_BELOW`."""
        descriptors = self._checked("descriptors", descriptors)
        if not len(descriptors):
            return
        spectra = encode(descriptors, self.settings.precision)
        rows = spectra._asdict()
        code = self.code
        if self.settings.code is not None:
            code = code or fit_code(descriptors, self.settings.code)
            rows["code"] = code.encode(descriptors)
        self.places.add(rows)
        if self.code is None:
            self._fitted = len(self)
        self.code, self.shape = code, (descriptors.shape[1], descriptors.shape[2])
        self._fit_again()

    def _fit_again(self) -> None:
        """Fit the code to all places once there are four times as many as it was fitted to."""
        if self.settings.code is None or self._fitted >= min(REFIT_BELOW, len(self) // 4 + 1):
            return
        blocks = self.places.blocks()
        if len(blocks) > 1 or self._shards:
            return
        spectra = Spectra(*(blocks[0][name] for name in Spectra._fields))
        descriptors = decode(spectra, self._shape)
        self.code = fit_code(descriptors, self.settings.code)
        self.places.replace("code", self.code.encode(descriptors))
        self._fitted = len(self)

    def mark(self) -> tuple[Any, ...]:
        """The present places, to which `rewind` goes back."""
        return self.places.mark(), self.code, self._fitted, self.shape

    def rewind(self, mark: tuple[Any, ...]) -> None:
        """Drop the places added since `mark`."""
        rows, self.code, self._fitted, self.shape = mark
        self.places.rewind(rows)

    def search(
        self,
        queries: Any,
        k: int = 1,
        *,
        exhaustive: bool | None = None,
        before: int | None = None,
    ) -> Hits:
        """The ``k`` places with the largest correlation, and the turn from place to query.

        Args:
            queries: descriptors (q, θ, ω).
            k: number of places.
            exhaustive: compare all places; by default if there are at most ``exhaustive_below``.
            before: ignore this place and those added after it.

        Raises:
            ConfigError: a ``k`` below 1, a ``before`` below 0, or a search by codes where the index
                stores none.
            DataError: queries of another shape than the places, or that are not finite.
        """
        count("k", k)
        if before is not None:
            count("before", before, 0)
        queries = self._checked("queries", queries)
        if exhaustive is None:
            exhaustive = self.code is None or len(self) <= self.settings.exhaustive_below
        number = len(self) if before is None else min(before, len(self))
        k = min(k, max(1, number))
        if not number:
            best = Best(len(queries), k, self.device)
        elif exhaustive:
            which = None if before is None else torch.arange(number, device=self.device)
            best = self._exact(padded_spectra(queries), k, which)
        elif self.code is None:
            raise ConfigError(
                "exhaustive: False, but the index stores no codes; set search.code, or omit it"
            )
        else:
            best = self._among_candidates(queries, self.code, k, number)
        if not bool((torch.isfinite(best.score) & (best.place >= 0)).all()):
            raise DataError(
                "index: places whose similarity is no finite number, expected finite descriptors; "
                "build the index again"
            )
        turn = shift_to_turn(best.shift, queries.shape[-2], self.period)
        return Hits(best.place, best.score / self.cells, turn)

    def candidates(
        self, queries: Float[Tensor, "q theta omega"], code: Code, number: int | None = None
    ) -> Int64[Tensor, "q c"]:
        """The places (q, c) int64 with the best codes among the first ``number``."""
        number = len(self) if number is None else number
        weights = code.queries(queries)
        scores = [code_scores(weights, codes, n) for n, codes in self.places.whole("code")]
        every = torch.cat(scores, dim=1)[:, :number]
        least = math.ceil(self.settings.candidate_share * number)
        size = min(max(self.settings.candidates, least), number)
        return every.topk(size, dim=1, sorted=False).indices

    def _exact(
        self,
        spectra: Float32[Tensor, "q k 2 w"],
        k: int,
        which: Int64[Tensor, " n"] | None = None,
    ) -> Best:
        form = exact.compiled if self.device.type == "cpu" else exact.batched
        return form(self.places, spectra, self._rows, k, which)

    def _among_candidates(
        self, queries: Float[Tensor, "q theta omega"], code: Code, k: int, number: int
    ) -> Best:
        best = Best(len(queries), k, self.device)
        if not len(queries):
            return best
        places = self.candidates(queries, code, number).sort(dim=1).values
        spectra = padded_spectra(queries)
        tops = [self._exact(spectra[q : q + 1], k, places[q]) for q in range(len(spectra))]
        names = ("score", "place", "shift")
        best.update(*(torch.cat([getattr(top, name) for top in tops]) for name in names))
        return best

    def save(self, folder: Path | str) -> None:
        """Write the places to a folder and memory-map them from there.

        Places already in that folder are neither read nor rewritten: save repeatedly to build or
        extend an index larger than memory. Raises FileError if the folder holds other files.
        """
        folder = Path(folder)
        blocks = self.places.blocks()
        shards = self._shards if folder == self._folder else ()
        if not shards and folder.is_dir() and any(folder.iterdir()):
            raise FileError(
                f"index {folder}: a folder with files; expected an empty or new folder, or the one "
                "that this index was opened from; choose another folder"
            )
        shards += tuple(
            write_shard(folder, number, blocks[number])
            for number in range(len(shards), len(blocks))
        )
        tensors = {} if self.code is None else {"basis": self.code.basis, "step": self.code.step}
        header = IndexHeader(self.settings, self.period, self.cells, self.shape, shards)
        write_sealed(folder / INDEX, FORMAT, header, tensors)
        self._attach(folder, shards)

    @classmethod
    def open(cls, folder: Path | str, *, check: bool = False) -> "CorrelationIndex":
        """Memory-map an index that `save` wrote; ``check`` reads and verifies every byte.

        Raises FileError for any other folder.
        """
        folder = Path(folder)
        file = open_sealed(folder / INDEX, FORMAT, check=True)
        header = file.header
        index = cls(header.settings, period=header.period, cells=header.cells)
        index.shape = header.shape
        index._attach(folder, header.shards, check=check)
        with file.contents():
            index._take_code(file.tensors.get("basis"), file.tensors.get("step"))
        return index

    def tensors(self) -> dict[str, Tensor]:
        """Rows of all places, as `restore` takes them, for a file; none without places."""
        blocks = self.places.blocks()
        return {
            name: torch.cat([block[name] for block in blocks], dim=axis_of(name))
            for name in (blocks[0] if blocks else ())
        }

    def restore(
        self,
        rows: Mapping[str, Tensor],
        shape: tuple[int, int] | None,
        basis: Tensor | None = None,
        step: Tensor | None = None,
    ) -> None:
        """Replace all places by rows of a `BlockStore`, e.g. memory-mapped ones.

        ``shape`` is (θ, ω) of the descriptors; ``basis`` and ``step`` are those of their code.
        Raises DataError if these do not match.
        """
        self.places = BlockStore()
        if rows:
            self.places.attach({name: value.to(self.device) for name, value in rows.items()})
        self.shape = shape
        self._take_code(basis, step)

    def _attach(self, folder: Path, shards: tuple[Shard, ...], check: bool = False) -> None:
        self.places = BlockStore()
        for block in read_shards(folder, shards, check=check):
            self.places.attach({name: value.to(self.device) for name, value in block.items()})
        self._folder, self._shards = folder, shards

    def _take_code(self, basis: Tensor | None, step: Tensor | None) -> None:
        """Set the code of the present places. Raises DataError if the two do not match."""
        self.code, settings, shape = None, self.settings.code, self.shape
        if shape is None:
            if self.places or basis is not None or step is not None:
                raise DataError("shape: missing, expected (θ, ω) of the descriptors")
            return
        if basis is not None and step is not None and settings is not None:
            code = Code(basis.to(self.device), step.to(self.device), self._rows)
            self.code = expect_code(code, shape, settings)
        elif basis is not None or step is not None or (self.places and settings is not None):
            raise DataError(
                "codes: present but search.code is null, or missing, or without their basis or "
                "step; expected all or none"
            )
        self._fitted = len(self)
        for block in self.places.blocks():
            expect_block(block, shape, self.settings.precision, self.code)

    @property
    def _rows(self) -> int:
        return self._shape[0]

    @property
    def _shape(self) -> tuple[int, int]:
        assert self.shape is not None
        return self.shape

    def _checked(self, name: str, values: Any) -> Float32[Tensor, "n theta omega"]:
        descriptors = given_descriptors(name, values, self.shape, ("θ", "ω"))
        return descriptors.to(self.device, torch.float32)
