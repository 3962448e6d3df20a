"""Descriptors on disk: made once, scored many times, on any machine.

One safetensors file a side: tensors, and a header of plain values that says what made them.
Nothing in it is executed when it is read. A SHA-256 over header and tensors tells an altered file.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.fingerprint import as_read_back, digest_of
from deepring.io.files import write_whole

#: Raise when what a file holds, or what it means, changes.
FORMAT_VERSION = 1

SideName = Literal["database", "query"]

#: Of the files' names.
ENDING = ".safetensors"

#: The key of the header in the file's metadata.
_KEY = "deepring"

_TENSORS = {"descriptors": np.float32, "positions": np.float64, "indices": np.int64}
_TEXTS = ("method", "train", "test", "region", "session")
_WANTED = "expected a descriptor file as evaluate_method(..., export=FOLDER) writes it"


@dataclass(frozen=True, eq=False)
class Descriptors:
    """The descriptors of one side of a retrieval set, n of them, and all that is known of them.

    Raises DeepringError for an empty set, for arrays of another type or of counts that disagree,
    for values that are not finite, and for text that a row of results cannot hold.
    """

    descriptors: NDArray[np.float32]
    """(n, ...), as the method's ``describe`` gives them."""
    positions: NDArray[np.float64]
    """(n, 2) world positions, metres."""
    indices: NDArray[np.int64]
    """(n,) numbers of the scans in their session."""
    method: str
    """Its label in tables."""
    train: str
    """What it was trained on; empty for a method without training."""
    test: str
    region: str
    side: SideName
    session: str
    made_by: dict[str, Any]
    """What made them, as `deepring.evaluation.fingerprint` states it and JSON gives it back."""
    ground_z: float
    """z of the ground under the sensor in the scans' frame, metres."""
    seconds_per_scan: float
    """From points to descriptor, measured on the queries when these were exported."""
    turns: NDArray[np.float64] | None = None
    """(n,) radians by which the scans were turned; None where they were left as they are."""

    def __post_init__(self) -> None:
        where = f"{self.test}, region {self.region}"
        if self.side not in get_args(SideName):
            raise DeepringError(f"side {self.side!r}: expected 'database' or 'query'")
        for name in _TEXTS:
            text = getattr(self, name)
            if not (isinstance(text, str) and text.isprintable()):
                raise DeepringError(f"{name} {text!r}: expected a str without control characters")
        for name in ("ground_z", "seconds_per_scan"):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not math.isfinite(value):
                raise DeepringError(f"{name} {value!r}: expected a finite float")
        if self.seconds_per_scan < 0:
            raise DeepringError(f"seconds_per_scan {self.seconds_per_scan}: expected at least 0")
        if not len(self.descriptors):
            holds = {"database": "database holds 0 places", "query": "query holds 0 scans"}
            raise DeepringError(f"{where}: the {holds[self.side]}; expected at least one")
        for name, array in self.tensors.items():
            self._check(f"{where}, {self.side}: {name}", name, array)
        object.__setattr__(self, "made_by", as_read_back(self.made_by))

    def __len__(self) -> int:
        return len(self.descriptors)

    @property
    def case(self) -> Case:
        """What they are about."""
        return Case(self.method, self.train, self.test, self.region)

    @property
    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name; ``turns`` where there are any."""
        arrays = {name: getattr(self, name) for name in _TENSORS}
        return arrays if self.turns is None else {**arrays, "turns": self.turns}

    def _check(self, where: str, name: str, array: NDArray[Any]) -> None:
        wanted = np.dtype(_TENSORS.get(name, np.float64))
        if array.dtype != wanted:
            raise DeepringError(
                f"{where} of {array.dtype}: expected {wanted}, which is what files hold; convert "
                "them, in the method's describe() where it makes them"
            )
        n = len(self.descriptors)
        shapes = {"descriptors": array.shape, "positions": (n, 2)}
        shape = shapes.get(name, (n,))
        if array.shape != shape:
            raise DeepringError(
                f"{where} of shape {array.shape}: expected {shape}, one for each of the {n} "
                "descriptors"
            )
        bad = int((~np.isfinite(array)).sum())
        if bad:
            raise DeepringError(
                f"{where}: {bad} of {array.size} values are not finite; expected numbers; look "
                "for empty scans, or for a training that diverged"
            )


def file_name(case: Case, side: SideName) -> str:
    """'Scan_Context_20x60__sim_nclt__test__query.safetensors': as files of matches are named."""
    return case.file_name(f"__{side}{ENDING}")


def free_path(folder: Path, case: Case, side: SideName) -> Path:
    """Where a side is written in a folder: to a new file, or in place of one of an equal case.

    Raises DeepringError where the file is there and holds something else.
    """
    path = folder / file_name(case, side)
    if not path.exists():
        return path
    try:
        other = read_descriptors(path).case
    except DeepringError as error:
        raise DeepringError(f"{error}; it lies where descriptors are to be: delete it") from None
    if other != case:
        raise DeepringError(
            f"{path}: holds the descriptors of {other}, expected those of {case}; "
            "give the methods labels that differ in letters or digits, or delete the file"
        )
    return path


def write_descriptors(path: str | Path, descriptors: Descriptors) -> None:
    """Write a descriptor file in one step, creating folders as needed.

    Raises DeepringError where the file cannot be written.
    """
    tensors = {name: np.ascontiguousarray(a) for name, a in descriptors.tensors.items()}
    plain = [field.name for field in fields(descriptors) if field.name not in tensors]
    header = {name: getattr(descriptors, name) for name in plain if name != "turns"}
    header["turned"] = descriptors.turns is not None
    metadata = {_KEY: _sealed({"version": FORMAT_VERSION, **header}, tensors)}
    write_whole(Path(path), [save(tensors, metadata)])


def read_descriptors(path: str | Path) -> Descriptors:
    """Read what `write_descriptors` wrote.

    Raises DeepringError for a file that is missing, no descriptor file, truncated, altered, or of
    another format version, and for contents that `Descriptors` refuses.
    """
    path = Path(path)
    if not path.is_file():
        raise DeepringError(f"descriptors {path}: no such file; {_WANTED}")
    try:
        with safe_open(path, framework="np") as file:
            header = _header(path, file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in sorted(file.keys())}
        checksum = header.pop("checksum", None)
        found = _checksum(header, tensors)
    except (SafetensorError, OSError, TypeError, ValueError, KeyError, AttributeError) as error:
        raise DeepringError(
            f"descriptors {path}: {error}; {_WANTED}; this is another file, or it was cut short "
            "or altered: copy it again, or export again"
        ) from error
    if checksum != found:
        raise DeepringError(
            f"descriptors {path}: checksum {found}, expected {checksum}, as its header says; the "
            "file was altered: copy it again, or export again"
        )
    contents = {name: value for name, value in header.items() if name not in ("version", "turned")}
    try:
        return Descriptors(**contents, **tensors)
    except DeepringError as error:
        raise DeepringError(f"descriptors {path}: {error}") from None
    except TypeError as error:
        raise DeepringError(f"descriptors {path}: {error}; {_WANTED}") from error


def _header(path: Path, metadata: Mapping[str, str]) -> dict[str, Any]:
    """The header, of this format version. Raises DeepringError or ValueError."""
    if _KEY not in metadata:
        raise DeepringError(
            f"descriptors {path}: safetensors without a header of ours (metadata "
            f"{sorted(metadata)}); {_WANTED}"
        )
    header = json.loads(metadata[_KEY])
    if not isinstance(header, dict):
        raise ValueError(f"its header is a {type(header).__name__}")
    version = header.get("version")
    if version != FORMAT_VERSION:
        raise DeepringError(
            f"descriptors {path}: format version {version!r}, expected {FORMAT_VERSION}; export "
            "again with this version of deepring, or read it with the one that wrote it"
        )
    return header


def _sealed(header: dict[str, Any], tensors: Mapping[str, NDArray[Any]]) -> str:
    """The header with its checksum, as JSON."""
    return json.dumps({**header, "checksum": _checksum(header, tensors)})


def _checksum(header: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over the header's values, whatever their order, and the tensors."""
    text = json.dumps(header, sort_keys=True)
    return hashlib.sha256((text + digest_of(tensors)).encode()).hexdigest()
