"""Search by circular cross-correlation: of all places, or of the best by a short code."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from deepring.checks import count, one_of, share
from deepring.core.correlation import shift_to_turn
from deepring.errors import ConfigError, DataError, FileError
from deepring.search import exact
from deepring.search.block_store import BlockStore
from deepring.search.code import Code, CodeSettings, code_scores, fit_code
from deepring.search.hits import Best, Hits
from deepring.search.shards import read_header, read_shards, write_header, write_shard
from deepring.search.spectra import Precision, encode, padded_spectra


@dataclass(frozen=True)
class SearchSettings:
    """How places are stored and looked up."""

    precision: Precision = "float32"
    code: CodeSettings | None = field(default_factory=CodeSettings)
    """None stores no codes: every search is exhaustive."""
    exhaustive_below: int = 20_000
    """Places up to which all are compared."""
    candidates: int = 500
    """Places that the codes leave for exact comparison."""
    candidate_share: float = 0.005
    """The same as a share of all places; the larger of the two counts."""

    def __post_init__(self) -> None:
        one_of("search.precision", self.precision, Precision)
        count("search.candidates", self.candidates)
        count("search.exhaustive_below", self.exhaustive_below, 0)
        share("search.candidate_share", self.candidate_share)


class CorrelationIndex:
    """Places by the θ-spectra of their descriptors (n, θ, ω), searched by Eq. 8.

    Args:
        settings: precision, codes and candidates.
        period: the range of θ, radians.
        cells: what scores are divided by.
        device: where places lie and are searched.
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
        self.shape: tuple[int, int] | None = None
        self._folder: Path | None = None
        self._saved = 0  # blocks of places that lie in that folder

    def __len__(self) -> int:
        return len(self.places)

    def add(self, descriptors: Tensor) -> None:
        """Add places. The code is made for the first ones added and kept for those that follow."""
        descriptors = self._checked(descriptors)
        if not len(descriptors):
            return
        spectra = encode(descriptors, self.settings.precision)
        rows = spectra._asdict()
        if self.settings.code is not None:
            if self.code is None:
                self.code = fit_code(descriptors, self.settings.code)
            rows["code"] = self.code.encode(descriptors)
        self.places.add(rows)

    def search(
        self,
        queries: Tensor,
        k: int = 1,
        *,
        exhaustive: bool | None = None,
        before: int | None = None,
    ) -> Hits:
        """The ``k`` places of the largest correlation, with the turn from place to query.

        Args:
            queries: descriptors (q, θ, ω).
            k: places wanted.
            exhaustive: compare all places; by default up to ``exhaustive_below`` of them.
            before: leave out this place and those added after it.
        """
        count("k", k)
        queries = self._checked(queries)
        if exhaustive is None:
            exhaustive = self.code is None or len(self) <= self.settings.exhaustive_below
        number = len(self) if before is None else max(0, min(before, len(self)))
        if exhaustive:
            which = None if before is None else torch.arange(number, device=self.device)
            best = self._exact(padded_spectra(queries), k, which)
        elif self.code is None:
            raise ConfigError(
                "exhaustive: False, but the index stores no codes; set search.code, or leave it out"
            )
        else:
            best = self._among_candidates(queries, self.code, k, number)
        turn = shift_to_turn(best.shift, queries.shape[-2], self.period)
        return Hits(best.place, best.score / self.cells, turn)

    def candidates(self, queries: Tensor, code: Code, number: int | None = None) -> Tensor:
        """The places (q, c) int64, of the first ``number``, that the codes put first."""
        number = len(self) if number is None else number
        weights = code.queries(queries)
        scores = [code_scores(weights, codes, used) for used, codes in self.places.whole("code")]
        every = torch.cat(scores, dim=1)[:, :number]
        least = math.ceil(self.settings.candidate_share * number)
        size = min(max(self.settings.candidates, least), number)
        return every.topk(size, dim=1, sorted=False).indices

    def _exact(self, spectra: Tensor, k: int, which: Tensor | None = None) -> Best:
        form = exact.compiled if self.device.type == "cpu" else exact.batched
        return form(self.places, spectra, self._rows, k, which)

    def _among_candidates(self, queries: Tensor, code: Code, k: int, number: int) -> Best:
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
        """Write the places to a folder and go on with them memory-mapped from there.

        Places that lie there already are neither read nor rewritten: save after each lot of
        places to build an index larger than memory, or to add to one. Raises DeepringError where
        the folder holds another index.
        """
        folder = Path(folder)
        blocks = self.places.blocks()
        saved = self._saved if folder == self._folder else 0
        if saved == 0 and folder.is_dir() and any(folder.iterdir()):
            raise FileError(
                f"index {folder}: holds files already; expected a folder that is empty or new, or "
                "the one that this index was opened from"
            )
        for number, block in enumerate(blocks[saved:], start=saved):
            write_shard(folder, number, block)
        tensors = {} if self.code is None else {"basis": self.code.basis, "step": self.code.step}
        values = {
            "settings": asdict(self.settings),
            "period": self.period,
            "cells": self.cells,
            "shape": self.shape,
        }
        lengths = [len(block["values"]) for block in blocks]
        write_header(folder, tensors, values, lengths)
        self._attach(folder, lengths)

    @classmethod
    def open(cls, folder: Path | str) -> "CorrelationIndex":
        """Open what `save` wrote, memory-mapped. Raises DeepringError for anything else."""
        folder = Path(folder)
        tensors, header = read_header(folder)
        try:
            settings = dict(header["settings"])
            code = settings.pop("code")
            code = None if code is None else CodeSettings(**code)
            index = cls(
                SearchSettings(code=code, **settings),
                period=header["period"],
                cells=header["cells"],
            )
            index.shape = None if header["shape"] is None else tuple(header["shape"])
            if tensors:
                index.code = Code(tensors["basis"], tensors["step"], index._rows)
            index._attach(folder, header["lengths"])
        except (KeyError, TypeError) as error:
            raise FileError(f"index {folder}: its header lacks {error}; write it again") from error
        return index

    def restore(
        self,
        rows: Mapping[str, Tensor],
        shape: Sequence[int],
        basis: Tensor | None = None,
        step: Tensor | None = None,
    ) -> None:
        """Take rows as `BlockStore` holds them, such as memory-mapped ones, in place of all places.

        ``shape`` is (θ, ω) of the descriptors; ``basis`` and ``step`` are those of their code.
        """
        self.places = BlockStore()
        self.places.attach({name: value.to(self.device) for name, value in rows.items()})
        self.shape = (shape[0], shape[1])
        coded = basis is not None and step is not None
        self.code = Code(basis, step, shape[0]) if coded else None  # type: ignore[arg-type]

    def _attach(self, folder: Path, lengths: list[int]) -> None:
        self.places = BlockStore()
        for block in read_shards(folder, lengths):
            self.places.attach({name: value.to(self.device) for name, value in block.items()})
        self._folder, self._saved = folder, len(lengths)

    @property
    def _rows(self) -> int:
        assert self.shape is not None
        return self.shape[0]

    def _checked(self, descriptors: Tensor) -> Tensor:
        if descriptors.ndim != 3:
            raise DataError(f"descriptors: shape {tuple(descriptors.shape)}, expected (n, θ, ω)")
        shape = (descriptors.shape[1], descriptors.shape[2])
        if self.shape is None:
            self.shape = shape
        if shape != self.shape:
            raise DataError(
                f"descriptors: {shape[0]} x {shape[1]}, but the places are {self.shape[0]} x "
                f"{self.shape[1]}; describe both by one method"
            )
        return descriptors.to(self.device, torch.float32)
