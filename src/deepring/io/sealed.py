"""Sealed files: tensors and plain values with digests, checked once when opened.

A sealed file is a safetensors file whose metadata hold, on two lines, the SHA-256 of a header and
that header as JSON text. The header holds the kind of the file, the version of its format, the
plain values, and dtype, shape and SHA-256 of every tensor. Maps, networks, indexes and descriptors
are such files, each with its own `SealedFormat`.

Digests tell that a file is whole, not that it means well: whoever makes a file makes its digests,
too. Hence types, shapes and ranges are checked as well when a file is opened, the ranges of plain
values by the dataclass of the header. Files are memory-mapped; their contents are never executed or
imported.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from deepring.errors import ConfigError, DataError, DeepringError, FileError
from deepring.io.files import replacing
from deepring.io.git_lfs import LFS_POINTER, is_lfs_pointer_file
from deepring.io.strict_json import read_json
from deepring.io.tensor_types import TensorTypes, check_tensors, check_values, dtype_of
from deepring.io.typed import field_values, typed
from deepring.text import shown

if TYPE_CHECKING:
    from torch import Tensor

H = TypeVar("H")

#: The metadata key of digest and header: a single one, since safetensors does not fix the order of
#: several.
_KEY = "deepring_sealed"

#: Metadata keys of the file formats before sealed files.
_OLD_KEYS = {"deepring", "deepring_index", "deepring_map", "deepring_network"}


@dataclass(frozen=True)
class SealedFormat(Generic[H]):
    """The format of one kind of files."""

    kind: str
    """Name of the kind, in messages and to distinguish files."""
    version: int
    """To be increased when the content of the files or its meaning changes."""
    header: type[H]
    """A dataclass of the plain values, with types that `deepring.io.typed.typed` supports."""
    tensors: TensorTypes
    description: str
    """The expected file in messages, e.g. "a map as Map.save writes it"."""
    remedy: str
    """Advice in messages about an unusable file, e.g. "build it again"."""


@dataclass(frozen=True, eq=False)
class Sealed(Generic[H]):
    """An opened file."""

    path: Path
    format: SealedFormat[H]
    header: H
    tensors: "dict[str, Tensor]"
    """Memory-mapped."""
    digest: str
    """SHA-256 of the header with its tensor digests, so that equal contents have equal digests."""
    tensor_digests: dict[str, str]

    def verify(self) -> None:
        """Read and verify every byte and value. Raises FileError for an altered tensor."""
        for name, tensor in self.tensors.items():
            if _tensor_digest(tensor) != self.tensor_digests[name]:
                raise FileError(
                    f"{self.format.kind} {self.path}: the tensor {name} was altered; expected the "
                    f"bytes that were written; copy it again, or {self.format.remedy}"
                )
        with self.contents():
            check_values(self.tensors, self.format.tensors, every=True)

    @contextmanager
    def contents(self) -> Iterator[None]:
        """Turn errors about the file's contents into FileErrors that name the file.

        FileErrors that name it already do not change.
        """
        with _named(self.path, self.format, self.format.remedy):
            yield


def write_sealed(
    path: Path | str, format: SealedFormat[H], header: H, tensors: "Mapping[str, Tensor]"
) -> str:
    """Write a file, completely or not at all, with the usual permissions of a new file.

    Equal contents give equal bytes. Returns the digest, as in `Sealed`. Raises FileError if the
    contents do not match the format, or the file cannot be written.
    """
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    path = Path(path)
    arrays = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with _named(path, format, "nothing was written"):
        check_tensors(arrays, format.tensors)
        text = _header_text(format, header, arrays)
    digest = _sha256(text.encode())
    with replacing(path) as temporary:
        temporary.touch()
        mode = temporary.stat().st_mode
        try:
            save_file(arrays, temporary, {_KEY: f"{digest}\n{text}"})
        except SafetensorError as error:
            raise FileError(f"{path}: cannot be written; expected enough disk space") from error
        temporary.chmod(mode)  # safetensors restricts it to the owner
    return digest


def open_sealed(path: Path | str, format: SealedFormat[H], *, check: bool = False) -> Sealed[H]:
    """Open a file, memory-mapped.

    Verifies everything except the tensors' bytes and the values of large ones, which ``check`` also
    reads and verifies. Raises FileError for a file that is missing, of another kind or version,
    truncated, altered, or with contents that do not match the format.
    """
    path = Path(path)
    if not path.is_file():
        state = "is a folder" if path.is_dir() else "no such file"
        raise FileError(f"{format.kind} {path}: {state}; expected {format.description}")
    metadata, tensors = _read(path, format)
    text = _sealed_text(path, format, metadata)
    values = _header_values(path, format, text)
    with _named(path, format, format.remedy):
        contents = typed(_Header, values, "header")
        if {name: _type_of(tensor) for name, tensor in tensors.items()} != {
            name: (entry.dtype, entry.shape) for name, entry in contents.tensors.items()
        }:
            raise DataError("tensors differ from those in its header")
        check_tensors(tensors, format.tensors)
        check_values(tensors, format.tensors)
        header = typed(format.header, contents.values, "header")
    digests = {name: entry.sha256 for name, entry in contents.tensors.items()}
    file = Sealed(path, format, header, tensors, _sha256(text.encode()), digests)
    if check:
        file.verify()
    return file


@dataclass(frozen=True)
class _TensorEntry:
    dtype: str
    shape: tuple[int, ...]
    sha256: str


@dataclass(frozen=True)
class _Header:
    """A header in its JSON form."""

    kind: str
    version: int
    tensors: dict[str, _TensorEntry]
    values: dict[str, Any]


def _header_text(format: SealedFormat[H], header: H, tensors: "Mapping[str, Tensor]") -> str:
    entries = {
        name: _TensorEntry(*_type_of(tensor), _tensor_digest(tensor))
        for name, tensor in tensors.items()
    }
    contents = {
        "kind": format.kind,
        "version": format.version,
        "tensors": entries,
        "values": header,
    }
    try:
        text = json.dumps(contents, sort_keys=True, default=field_values, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ConfigError(
            "header: a value without a JSON form, expected plain values and finite numbers"
        ) from error
    typed(format.header, read_json(text)["values"], "header")
    return text


def _read(path: Path, format: SealedFormat[Any]) -> "tuple[dict[str, str], dict[str, Tensor]]":
    """Metadata and memory-mapped tensors of any safetensors file."""
    from safetensors import safe_open

    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in sorted(file.keys())}
            return file.metadata() or {}, tensors
    except Exception as error:  # the libraries raise many types for a damaged file
        if is_lfs_pointer_file(path):
            raise FileError(f"{format.kind} {path}: {LFS_POINTER}") from error
        raise FileError(
            f"{format.kind} {path}: no complete safetensors file: of another type, cut short or "
            f"altered; expected {format.description}; copy it again, or {format.remedy}"
        ) from error


def _sealed_text(path: Path, format: SealedFormat[Any], metadata: Mapping[str, str]) -> str:
    """The header's text, verified by its digest."""
    if _KEY not in metadata:
        raise FileError(
            f"{format.kind} {path}: written by an earlier version of deepring; expected format "
            f"version {format.version}; {format.remedy}"
            if _OLD_KEYS & set(metadata)
            else f"{format.kind} {path}: a safetensors file that deepring did not write; expected "
            f"{format.description}; choose such a file"
        )
    digest, _, text = metadata[_KEY].partition("\n")
    if _sha256(text.encode()) != digest:
        raise FileError(
            f"{format.kind} {path}: its header was altered; expected the one that was written; "
            f"copy it again, or {format.remedy}"
        )
    return text


def _header_values(path: Path, format: SealedFormat[Any], text: str) -> Any:
    """The header's values, of this kind and version."""
    with _named(path, format, format.remedy):
        values = read_json(text)
    try:
        kind, version = values["kind"], values["version"]
    except (KeyError, TypeError) as error:
        raise FileError(
            f"{format.kind} {path}: a header without kind and version; expected "
            f"{format.description}; {format.remedy}"
        ) from error
    if kind != format.kind:
        raise FileError(
            f"{format.kind} {path}: a file of kind {shown(kind, 80)}; expected "
            f"{format.description}; choose such a file"
        )
    if version != format.version or isinstance(version, bool):
        raise FileError(
            f"{format.kind} {path}: format version {shown(version, 80)}, expected "
            f"{format.version}; {format.remedy} with this version of deepring"
        )
    return values


@contextmanager
def _named(path: Path, format: SealedFormat[Any], remedy: str) -> Iterator[None]:
    try:
        yield
    except DeepringError as error:
        if isinstance(error, FileError) and str(path) in str(error):
            raise
        raise FileError(f"{format.kind} {path}: {error}; {remedy}") from error


def _type_of(tensor: "Tensor") -> tuple[str, tuple[int, ...]]:
    return dtype_of(tensor), tuple(tensor.shape)


def _tensor_digest(tensor: "Tensor") -> str:
    import torch

    return _sha256(tensor.reshape(-1).view(torch.uint8).numpy().data)


def _sha256(content: bytes | memoryview) -> str:
    return hashlib.sha256(content).hexdigest()
