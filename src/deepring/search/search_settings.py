"""Settings of an index: what it stores of a place, and how many places it compares."""

from dataclasses import dataclass, field

from deepring.checks import count, one_of, share
from deepring.search.code import CodeSettings
from deepring.search.spectra import Precision


@dataclass(frozen=True)
class SearchSettings:
    """Settings of an index: storage and search."""

    precision: Precision = "float32"
    code: CodeSettings | None = field(default_factory=CodeSettings)
    """None stores no codes, and every search is exhaustive."""
    exhaustive_below: int = 20_000
    """Number of places up to which all are compared."""
    candidates: int = 500
    """Number of places that codes select for exact comparison."""
    candidate_share: float = 0.005
    """The same as a share of all places; the larger of the two applies."""

    def __post_init__(self) -> None:
        one_of("search.precision", self.precision, Precision)
        count("search.candidates", self.candidates)
        count("search.exhaustive_below", self.exhaustive_below, 0)
        share("search.candidate_share", self.candidate_share)
