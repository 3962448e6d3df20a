"""Looking a query up among N places, beside the usual routes."""

from collections.abc import Callable, Iterator

import numpy as np
import torch
from scenes import places, revisits, rings
from scipy.spatial import KDTree
from timing import Row, timed
from torch import Tensor

from deepring.core.correlation import circular_cross_correlation
from deepring.localization.map_file import SEARCH
from deepring.methods.method import describe_all
from deepring.methods.network_file import load_network
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.search_settings import SearchSettings
from deepring.search.spectra import encode
from deepring.search.vector_index import VectorIndex

#: Places of which real descriptors are made; larger maps repeat them with noise.
DRAWN = 10_000


def published_correlation(a: Tensor, b: Tensor) -> float:
    """What lus6-Jenny/RING computes of a pair, straightforwardly: both transforms, the inverse
    of each ω, magnitudes, sum, maximum."""
    product = torch.fft.fft(a, dim=0) * torch.fft.fft(b, dim=0).conj()
    return float(torch.fft.ifft(product, dim=0).abs().sum(dim=1).max())


def descriptors(n: int, angles: int, seed: int = 0) -> Tensor:
    """RING's descriptors (n, angles, 61) of drawn places, and beyond `DRAWN` noisy repeats."""
    drawn = rings(places(min(n, DRAWN), seed), angles)
    if n <= DRAWN:
        return drawn
    generator = torch.Generator().manual_seed(seed)
    out = drawn.repeat(-(-n // DRAWN), 1, 1)[:n]
    for start in range(0, n, 4096):
        part = out[start : start + 4096]
        out[start : start + 4096] += 0.01 * torch.randn(part.shape, generator=generator)
    return out


def exact_stages(runs: int, sizes: tuple[int, ...], device: str = "cpu") -> Iterator[Row]:
    """All places compared, by precision and number of queries."""

    def finished(function: Callable[[], object]) -> Callable[[], object]:
        def call() -> object:
            found = function()
            if device != "cpu":
                torch.cuda.synchronize()
            return found

        return call

    queries = rings(revisits(np.arange(0, DRAWN, DRAWN // 64)[:64], DRAWN))
    for n in sizes:
        database = descriptors(n, 120)
        exact = circular_cross_correlation(queries[:8], database[: min(n, 4096)])
        for precision in ("float32", "bfloat16", "int8"):
            index = CorrelationIndex(SearchSettings(precision, code=None), device=device)
            for part in database.split(4096):
                index.add(part)
            found = index.search(queries, 1)
            if n <= 4096 and precision == "float32":
                assert torch.equal(found.place[:8, 0].cpu(), exact.score.argmax(dim=1))
            if precision == "float32":
                reference = found.place
            agreed = float((found.place == reference).float().mean())
            for count in (1, 64):
                few = queries[:count]
                seconds = timed(
                    finished(lambda index=index, few=few: index.search(few)),
                    runs if n <= 10_000 else 3,
                    n * count,
                    1,
                )
                what = f"exact search, {precision}, {count} quer{'y' if count == 1 else 'ies'}"
                note = f"same top-1 as float32: {agreed:.3f} of 64"
                yield Row("search", what, n, *seconds, "pair", note)


def published_stage(runs: int, n: int = 10_000) -> Iterator[Row]:
    """The published form, a pair at a time and as one batch."""
    database = descriptors(n, 120)
    full = torch.cat([database, database[..., 1:-1].flip(-1)], dim=-1)  # ω < 0 as well
    queries = rings(revisits(np.arange(0, DRAWN, DRAWN // 64)[:64], DRAWN))
    wide = torch.cat([queries, queries[..., 1:-1].flip(-1)], dim=-1)
    sample = full[: min(n, 500)]

    def pairs() -> None:
        for entry in sample:
            published_correlation(wide[0], entry)

    seconds = timed(pairs, max(3, runs // 10), len(sample), 1)
    same = []
    index = CorrelationIndex(SearchSettings(code=None))
    index.add(database)
    for query, place in zip(wide[:16], index.search(queries[:16]).place[:, 0], strict=True):
        scores = torch.cat([_published_batch(query, part) for part in full.split(256)])
        same.append(int(scores.argmax()) == int(place))
    note = f"its top-1 is that of the exact search in {sum(same)} of {len(same)} queries"
    what = "peer: RING's published correlation, torch"
    yield Row("search", what, n, *seconds, "pair", note)


def _published_batch(query: Tensor, database: Tensor) -> Tensor:
    product = torch.fft.fft(query, dim=0) * torch.fft.fft(database, dim=1).conj()
    return torch.fft.ifft(product, dim=1).abs().sum(dim=2).amax(dim=1)


def context_stage(runs: int, sizes: tuple[int, ...]) -> Iterator[Row]:
    """Scan Context as it is usually written: a KD-tree over ring keys, then 10 candidates."""
    rng = np.random.default_rng(0)
    query = rng.uniform(0, 8, (20, 60)) * (rng.random((20, 60)) > 0.5)
    for n in sizes:
        contexts = rng.uniform(0, 8, (n, 20, 60)).astype(np.float32)
        contexts *= rng.random((n, 20, 60)) > 0.5
        tree = KDTree(contexts.mean(axis=2))

        def look_up(contexts: np.ndarray = contexts, tree: KDTree = tree) -> float:
            _, near = tree.query(query.mean(axis=1), k=min(10, len(contexts)))
            return min(context_distance(query, contexts[k]) for k in np.atleast_1d(near))

        seconds = timed(look_up, runs)
        yield Row("search", "peer: Scan Context, KD-tree and 10 candidates", n, *seconds, "query")


def context_distance(a: np.ndarray, b: np.ndarray) -> float:
    """1 - mean cosine of the columns filled in both, at the best of all column shifts."""
    best = 1.0
    norm_b = np.linalg.norm(b, axis=0)
    for shift in range(a.shape[1]):
        turned = np.roll(a, shift, axis=1)
        norm_a = np.linalg.norm(turned, axis=0)
        filled = (norm_a > 0) & (norm_b > 0)
        if filled.any():
            cosines = (turned * b).sum(axis=0)[filled] / (norm_a * norm_b)[filled]
            best = min(best, 1 - float(cosines.mean()))
    return best


def two_stage(runs: int, sizes: tuple[int, ...]) -> Iterator[Row]:
    """Codes first, exact correlation of the best: 60 x 31 descriptors, as the small network's."""
    drawn = rings(places(DRAWN), 60)[..., :31]
    queries = drawn[:8].roll(7, dims=1)
    for n in sizes:
        index = CorrelationIndex(SearchSettings("int8", exhaustive_below=0))
        generator = torch.Generator().manual_seed(0)
        for start in range(0, n, 50_000):
            count = min(50_000, n - start)
            some = drawn.repeat(-(-count // len(drawn)), 1, 1)[:count]
            some += 0.02 * torch.randn(some.shape, generator=generator)
            index.add(some)
        one = queries[:1]
        seconds = timed(lambda index=index, one=one: index.search(one), max(5, runs // 4))
        yield Row("search", "two-stage search, int8", n, *seconds, "query")
        codes = timed(
            lambda index=index, one=one: index.candidates(one, index.code), max(5, runs // 4)
        )
        yield Row("search", "of which: codes and candidates", n, *codes, "query")
        if n <= 100_000:
            every = timed(lambda index=index, one=one: index.search(one, exhaustive=True), 3)
            yield Row("search", "exact search, int8, 60 x 31", n, *every, "query")


def network_stage(runs: int, n: int = 4096) -> Iterator[Row]:
    """Descriptors of the package's network and of the width it once had: time per number."""
    bevs = places(n)
    small = rings(bevs, 60)[..., :31]
    whole = describe_all(load_network("shipped").method, bevs)
    for what, database in (("60 x 31", small), ("60 x 151, the package's network", whole)):
        for name, settings in (("exact", SearchSettings("int8", code=None)), ("map's", SEARCH)):
            index = CorrelationIndex(settings)
            index.add(database)
            one = database[:1].roll(7, dims=1)
            seconds = timed(lambda index=index, one=one: index.search(one), runs)
            note = f"{1e9 * seconds[0] / database.numel():.3f} ns per number of the map"
            yield Row("search", f"{name} search, int8, {what}", n, *seconds, "query", note)


def vector_stage(runs: int, sizes: tuple[int, ...], width: int = 256) -> Iterator[Row]:
    """Vectors of 256 numbers, as PointNetVLAD's and EgoNN's."""
    generator = torch.Generator().manual_seed(0)
    for n in sizes:
        index = VectorIndex("l2")
        index.add(torch.randn(n, width, generator=generator))
        query = torch.randn(1, width, generator=generator)
        seconds = timed(lambda index=index, query=query: index.search(query), runs)
        yield Row("search", "vectors of 256, L2", n, *seconds, "query")


def bytes_of_a_place(angles: int, columns: int) -> dict[str, int]:
    """What a map keeps of a place, by precision."""
    one = torch.rand(1, angles, columns)
    sizes = {}
    for precision in ("float32", "bfloat16", "int8"):
        values = encode(one, precision).values
        sizes[precision] = values.numel() * values.element_size()
    return sizes
