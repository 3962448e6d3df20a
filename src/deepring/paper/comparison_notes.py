"""What is to be said below the tables of a comparison."""

from collections.abc import Iterable, Mapping, Sequence

from deepring.paper.comparison_blocks import Block, Name, paper_of
from deepring.paper.comparison_values import family, slip


def block_notes(name: Name, blocks: Sequence[Block]) -> list[str]:
    """What the values are means of, how many queries count, and what the paper's values are."""
    notes = [*_about_seeds(blocks), *map(_answerable, blocks)]
    with_paper = [block for block in blocks if any(paper_of(name, row) for row in block.rows)]
    named = [(family(block.test) or "", block.test) for block in with_paper]
    simulated = [f"{paper} beside {ours}" for paper, ours in named if paper.lower() != ours.lower()]
    if simulated:
        notes.append(f"the paper's values are of the real datasets: {', '.join(simulated)}")
    return notes + [note for block in with_paper for note in _about_slips(name, block)]


def remark_notes(blocks: Iterable[Block], remarks: Mapping[str, Sequence[str]]) -> list[str]:
    """What the configs of the methods in these blocks say of them."""
    shown = dict.fromkeys(row.case.method for block in blocks for row in block.rows)
    return [f"{name}: {'; '.join(remarks[name])}" for name in shown if name in remarks]


def about_means(seeds: Sequence[int]) -> str:
    """What a value over these seeds is."""
    if len(seeds) == 1:
        return f"one run a row, seed {seeds[0]}"
    return f"mean ± sample standard deviation over the seeds {listed(seeds)}"


def listed(seeds: Iterable[int]) -> str:
    """'0, 1, 2'."""
    return ", ".join(map(str, seeds))


def _about_seeds(blocks: Iterable[Block]) -> list[str]:
    """One note where all blocks have the same seeds, else which have which; and what lacks some."""
    places: dict[str, list[str]] = {}
    lacking = []
    for block in blocks:
        places.setdefault(about_means(block.seeds), []).append(block.place)
        if not block.alike:
            rows = [row for row in block.rows if sorted(row.results) != block.seeds]
            have = "; ".join(f"{row.case.method} has {listed(row.results)}" for row in rows)
            lacking.append(
                f"{block.place}: rows are not over the same seeds, so that none is marked best: "
                f"{have}"
            )
    if len(places) == 1:
        return [*places, *lacking]
    return [f"{', '.join(where)}: {note}" for note, where in places.items()] + lacking


def _answerable(block: Block) -> str:
    """'sim_nclt test: queries answerable: 190 of 200 (seed 0), 180 of 199 (seed 1)'."""
    seeds: dict[str, list[int]] = {}
    for seed in block.seeds:
        of_seed = [row.results[seed] for row in block.rows if seed in row.results]
        texts = dict.fromkeys(f"{result.answerable} of {result.queries}" for result in of_seed)
        seeds.setdefault(" or ".join(texts), []).append(seed)
    several = len(seeds) > 1
    counts = [f"{text} (seed {listed(of)})" if several else text for text, of in seeds.items()]
    return f"{block.place}: queries answerable: {', '.join(counts)}"


def _about_slips(name: Name, block: Block) -> Iterable[str]:
    notes: dict[str, None] = {}  # once for each method
    for row in block.rows:
        rates = paper_of(name, row)
        bound = None if rates is None else slip(rates)
        if rates is not None and bound is not None:
            note = (
                f"the paper's F1 of {row.case.method} on {family(block.test)}, "
                f"{rates.f1_max:.3f}, looks like a slip: it lies below 2R/(1+R) = {bound:.3f}, "
                f"which accepting every query gives for its Recall@1 of {rates.recall_1:.3f} where "
                "all are answerable"
            )
            notes[note] = None
    return notes
