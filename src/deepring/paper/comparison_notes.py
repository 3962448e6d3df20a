"""Notes below the tables of a comparison."""

from collections.abc import Iterable, Mapping, Sequence

from deepring.paper.comparison import Block, Name, paper_of
from deepring.paper.paper_values import family, slip
from deepring.paper.seed_groups import seeds_of
from deepring.paper.seed_words import about_lacking, about_means, listed


def block_notes(name: Name, blocks: Sequence[Block]) -> list[str]:
    """Notes on the means, on the queries that count, and on the paper's values."""
    means = about_groups((block[0].case.place, seeds_of(block)) for block in blocks)
    lacking = [
        f"{block[0].case.place}: {note}"
        for block in blocks
        for note in about_lacking(block, lambda row: row.case.method)
    ]
    notes = [*means, *lacking, *map(_answerable, blocks)]
    with_paper = [block for block in blocks if any(paper_of(name, row) for row in block)]
    tests = [block[0].case.test for block in with_paper]
    simulated = [f"{family(test)} beside {test}" for test in tests if not _is_papers(test)]
    if simulated:
        notes.append(f"the paper's values are of the real datasets: {', '.join(simulated)}")
    return notes + [note for block in with_paper for note in _about_slips(name, block)]


def about_groups(groups: Iterable[tuple[str, Sequence[int]]]) -> list[str]:
    """Notes on the values of each named group; one note if all have the same seeds."""
    names: dict[str, list[str]] = {}
    for name, seeds in groups:
        names.setdefault(about_means(seeds), []).append(name)
    if len(names) == 1:
        return list(names)
    return [f"{', '.join(where)}: {note}" for note, where in names.items()]


def remark_notes(blocks: Iterable[Block], remarks: Mapping[str, Sequence[str]]) -> list[str]:
    """Notes from the configs of the methods in these blocks."""
    shown = dict.fromkeys(row.case.method for block in blocks for row in block)
    return [f"{name}: {'; '.join(remarks[name])}" for name in shown if name in remarks]


def _is_papers(dataset: str) -> bool:
    """Whether it has the name of one of the paper's methods, whose values stand beside it."""
    return dataset.lower() == (family(dataset) or "").lower()


def _answerable(block: Block) -> str:
    """'sim_nclt test: queries answerable: 190 of 200 (seed 0), 180 of 199 (seed 1)'."""
    seeds: dict[str, list[int]] = {}
    for seed in seeds_of(block):
        of_seed = [row.results[seed] for row in block if seed in row.results]
        texts = dict.fromkeys(f"{result.answerable} of {result.queries}" for result in of_seed)
        seeds.setdefault(" or ".join(texts), []).append(seed)
    several = len(seeds) > 1
    counts = [f"{text} (seed {listed(of)})" if several else text for text, of in seeds.items()]
    return f"{block[0].case.place}: queries answerable: {', '.join(counts)}"


def _about_slips(name: Name, block: Block) -> Iterable[str]:
    notes: dict[str, None] = {}  # once for each method
    for row in block:
        rates = paper_of(name, row)
        bound = None if rates is None else slip(rates)
        if rates is not None and bound is not None:
            note = (
                f"the paper's F1 of {row.case.method} on {family(row.case.test)}, "
                f"{rates.f1_max:.3f}, looks like a slip: it lies below 2R/(1+R) = {bound:.3f}, "
                f"which accepting every query gives for its Recall@1 of {rates.recall_1:.3f} where "
                "all are answerable"
            )
            notes[note] = None
    return notes
