"""Exhaustive L2 search of 100 000 vectors of 256 numbers, k = 10: ours, and FAISS's flat index.

    OMP_NUM_THREADS=1 python benchmarks/vector_search.py

FAISS is measured where it is installed (``pip install faiss-cpu``); the package does not need it.
"""

import argparse
from collections.abc import Callable

import torch
from timing import timed
from torch import Tensor

from deepring.search.vector_index import SPARE, VectorIndex

K = 10


def flat_index(database: Tensor) -> Callable[[Tensor], Tensor] | None:
    """FAISS's search with ours of its candidates, which its L2 by products needs as well."""
    try:
        import faiss
    except ImportError:
        return None
    faiss.omp_set_num_threads(torch.get_num_threads())
    index = faiss.IndexFlatL2(database.shape[1])
    index.add(database.numpy())

    def search(queries: Tensor) -> Tensor:
        _, near = index.search(queries.numpy(), K + SPARE)
        near.sort(axis=1)
        vectors = torch.from_numpy(index.reconstruct_batch(near.ravel())).view(*near.shape, -1)
        distance = torch.linalg.vector_norm(queries[:, None] - vectors, dim=-1)
        order = distance.argsort(dim=1, stable=True)[:, :K]
        return torch.from_numpy(near).gather(1, order)

    return search


def main() -> None:
    """Print median milliseconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--places", type=int, default=100_000)
    parser.add_argument("--width", type=int, default=256)
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    generator = torch.Generator().manual_seed(0)
    database = torch.randn(args.places, args.width, generator=generator)
    index = VectorIndex("l2")
    for part in database.split(4096):
        index.add(part)
    other = flat_index(database)
    for count in (1, 64):
        queries = torch.randn(count, args.width, generator=generator)
        ours, low, high = timed(lambda queries=queries: index.search(queries, K), args.runs)
        line = f"{count:3d} queries: torch {1e3 * ours:.1f} ms ({1e3 * low:.1f} - {1e3 * high:.1f})"
        if other is not None:
            assert torch.equal(other(queries), index.search(queries, K).place)
            theirs, low, high = timed(lambda queries=queries: other(queries), args.runs)
            line += f", FAISS {1e3 * theirs:.1f} ms ({1e3 * low:.1f} - {1e3 * high:.1f})"
        print(line)


if __name__ == "__main__":
    main()
