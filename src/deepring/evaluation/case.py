"""Cases: which method was tested where. Results, matches and descriptors belong to one."""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from deepring.errors import ConfigError

#: Training datasets that a table names all.
_FEW = 3


@dataclass(frozen=True, order=True)
class Case:
    """A method, trained on one dataset, tested in a region of another.

    Raises ConfigError for text that one line of a file cannot hold.

    >>> print(Case("RING", "", "nclt", "test"))
    RING, tested on nclt test
    """

    method: str
    """Label of the method in tables."""
    train: str
    """Several datasets joined by '+'; empty for a method that learns nothing."""
    test: str
    region: str

    def __post_init__(self) -> None:
        for name, text in self.columns.items():
            if not isinstance(text, str) or not text.isprintable():
                raise ConfigError(f"{name}: {text!r}, expected a str without control characters")

    def __str__(self) -> str:
        trained = f" trained on {self.trained_on}" if self.train else ""
        return f"{self.method}{trained}, tested on {self.place}"

    @property
    def columns(self) -> dict[str, str]:
        """The four texts by name, as files state them."""
        return asdict(self)

    @property
    def place(self) -> str:
        """Test dataset and region: 'nclt test'."""
        return f"{self.test} {self.region}".strip()

    @property
    def trained_on(self) -> str:
        """The training datasets as a table shows them: the first ones of many, and their number.

        >>> Case("DeepRING", "a+b+c+d+e", "nclt", "test").trained_on
        'a and 4 more'
        """
        return shortened(self.train.split("+"), "+")

    @property
    def in_domain(self) -> bool:
        """Whether it was trained on the dataset that it is tested on, and on no other."""
        return self.train == self.test

    @property
    def crosses(self) -> bool:
        """Whether it was trained, but not on the dataset that it is tested on."""
        return bool(self.train) and self.test not in self.train.split("+")

    def file_name(self, ending: str) -> str:
        """A file name with letters, digits, '-' and '_' before the ending.

        >>> Case("Scan Context 20x60", "", "sim_nclt", "test").file_name(".csv")
        'Scan_Context_20x60__sim_nclt__test.csv'
        """
        return "__".join(map(in_file_names, (self.method, self.test, self.region))) + ending


def in_file_names(text: str) -> str:
    """A text as part of a file's name: letters, digits, '-' and '_'.

    >>> in_file_names("../RING 120"), in_file_names("RING++")
    ('_RING_120', 'RINGplusplus')
    """
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text.replace("+", "plus"))


def shortened(names: Sequence[str], joint: str) -> str:
    """Names put together; of many the first, and the number of the others."""
    if len(names) <= _FEW:
        return joint.join(names)
    return f"{names[0]} and {len(names) - 1} more"
