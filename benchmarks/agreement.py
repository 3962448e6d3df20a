"""How often a cheaper search finds what exact search in float32 finds, on a network's descriptors.

    deepring evaluate -m checkpoint=shipped data=sim_nclt_worlds,sim_mulran_worlds seed=0,1,2 \\
      evaluation.regions=[whole] evaluation.descriptors=true \\
      data.spacing.database=0.5 data.spacing.query=5
    python benchmarks/agreement.py outputs/sweeps/evaluate_sweep/*/descriptors

Takes folders of descriptor files as `evaluation.descriptors=true` writes them, puts all databases
together and all queries, and compares: precisions of the spectra, sizes of the code, two-stage with
exhaustive search, and how the rank of the best place among the codes grows with the map.
"""

import argparse
from pathlib import Path

import torch
from torch import Tensor

from deepring.evaluation.descriptors import read_descriptors
from deepring.search.code import CodeSettings, code_scores, fit_code
from deepring.search.correlation_index import CorrelationIndex
from deepring.search.search_settings import SearchSettings

CANDIDATES = (10, 50, 100, 500)


def read(folders: list[Path], side: str, method: str) -> Tensor:
    """All descriptors of one side in these folders."""
    files = [file for folder in folders for file in sorted(folder.glob(f"*__{side}.safetensors"))]
    found = [read_descriptors(file) for file in files]
    chosen = [torch.from_numpy(held.descriptors) for held in found if held.case.method == method]
    if not chosen:
        raise SystemExit(f"no {side} descriptors of {method} in {', '.join(map(str, folders))}")
    return torch.cat(chosen)


def ranks(queries: Tensor, database: Tensor, best: Tensor, settings: CodeSettings) -> Tensor:
    """How many places the codes put before the best one, (q,)."""
    code = fit_code(database, settings)
    scores = code_scores(code.queries(queries), code.encode(database))
    return (scores > scores.gather(1, best[:, None])).sum(dim=1)


def shares(found: Tensor) -> str:
    return " | ".join(f"{float((found < count).float().mean()):.4f}" for count in CANDIDATES)


def print_codes(queries: Tensor, database: Tensor, best: Tensor) -> None:
    """Where codes of several sizes put the best place."""
    head = " | ".join(f"in the best {count}" for count in CANDIDATES)
    print(f"\n| code, bytes | {head} |\n| --- |{' ---: |' * len(CANDIDATES)}")
    for frequencies, components in ((16, 24), (16, 16), (12, 16), (10, 16), (8, 16), (8, 12)):
        found = ranks(queries, database, best, CodeSettings(frequencies, components))
        size = 2 * frequencies * components
        print(f"| {frequencies} x {components}, {size} | {shares(found)} |")


def print_growth(queries: Tensor, database: Tensor) -> None:
    """Where the default code puts the best place, and what two stages find, as the map grows."""
    head = " | ".join(f"in the best {count}" for count in CANDIDATES)
    print(f"\n| places | {head} | rank at 99 % | two stages, same top-1 |")
    print(f"| ---: |{' ---: |' * (len(CANDIDATES) + 2)}")
    order = torch.randperm(len(database), generator=torch.Generator().manual_seed(1))
    for part in (16, 4, 1):
        some = database[order[: len(database) // part]]
        index = CorrelationIndex()
        index.add(some)
        best = index.search(queries, exhaustive=True).place[:, 0]
        same = index.search(queries, exhaustive=False).place[:, 0] == best
        found = ranks(queries, some, best, CodeSettings())
        at = int(found.float().quantile(0.99))
        print(f"| {len(some)} | {shares(found)} | {at} | {float(same.float().mean()):.4f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--method", default="DeepRING")
    parser.add_argument("--queries", type=int, default=1000, help="taken at random, seed 0")
    args = parser.parse_args()
    database = read(args.folders, "database", args.method)
    queries = read(args.folders, "query", args.method)
    order = torch.randperm(len(queries), generator=torch.Generator().manual_seed(0))
    queries = queries[order[: args.queries]]
    rows, columns = database.shape[1:]
    print(f"{len(queries)} queries, {len(database)} places, {args.method}, {rows} x {columns}\n")

    print(
        "| spectra | same top-1 as float32 | its top-1 among the best 10 |\n| --- | ---: | ---: |"
    )
    best = torch.empty(0)
    for precision in ("float32", "bfloat16", "int8"):
        index = CorrelationIndex(SearchSettings(precision, code=None))
        index.add(database)
        place = index.search(queries, 10).place
        best = place[:, 0] if precision == "float32" else best
        same = float((place[:, 0] == best).float().mean())
        near = float((place == best[:, None]).any(dim=1).float().mean())
        print(f"| {precision} | {same:.4f} | {near:.4f} |")

    print_codes(queries, database, best)
    print_growth(queries, database)


if __name__ == "__main__":
    main()
