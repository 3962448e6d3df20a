"""Labels of re-ranked methods in results, so that their rows cannot be confused."""

NAMES: dict[str, str] = {
    "pose": "{} + pose re-ranking",
    "locate": "{} + map poses (localisation)",
}
"""By `deepring.localization.candidates.Rerank`, with a place for the label of the method itself."""


def method_label(label: str) -> str:
    """The label of the method itself, of that of a re-ranked one.

    >>> method_label("RING + pose re-ranking"), method_label("RING")
    ('RING', 'RING')
    """
    for name in NAMES.values():
        label = label.removesuffix(name.format(""))
    return label
