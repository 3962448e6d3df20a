"""One file for tensors and the plain values that belong to them: sealed, and checked once.

A sealed file is a safetensors file whose metadata hold, on two lines, the SHA-256 of a header and
that header as JSON text. The header states what kind of file it is, the version of that kind's
format, the plain values, and dtype, shape and SHA-256 of every tensor. Maps, networks, indexes and
descriptors are such files: each states its kind, version, values and tensors as a `SealedFormat`.

Files are memory-mapped when opened. Nothing in them is executed, and nothing is imported by a name
that stands in one.
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
from deepring.io.tensor_types import TensorTypes, check_tensors, dtype_of
from deepring.io.typed import field_values, typed

if TYPE_CHECKING:
    from torch import Tensor

H = TypeVar("H")

#: Where digest and header stand in the metadata: under one key, since the order of several differs
#: from one writing to the next.
_KEY = "deepring_sealed"

#: Where headers stood before there were sealed files.
_BEFORE = {"deepring", "deepring_index", "deepring_map", "deepring_network"}


@dataclass(frozen=True)
class SealedFormat(Generic[H]):
    """What files of one kind hold."""

    kind: str
    """For messages, and so that no file is taken for one of another kind."""
    version: int
    """To be raised when what a file holds, or what it means, changes."""
    header: type[H]
    """A dataclass of the plain values; see `deepring.io.typed.typed` for types it can have."""
    tensors: TensorTypes
    wanted: str
    """What to expect of a file, such as "a map as Map.save writes it"."""
    remedy: str
    """What to do about a file that cannot be used, such as "build it again"."""


@dataclass(frozen=True, eq=False)
class Sealed(Generic[H]):
    """An opened file."""

    path: Path
    format: SealedFormat[H]
    header: H
    tensors: "dict[str, Tensor]"
    """Memory-mapped."""
    digest: str
    """SHA-256 of the header, which states those of the tensors: the same for equal contents."""
    tensor_digests: dict[str, str]

    def verify(self) -> None:
        """Read every byte. Raises FileError where a tensor is not what was written."""
        for name, tensor in self.tensors.items():
            if _tensor_digest(tensor) != self.tensor_digests[name]:
                raise FileError(
                    f"{self.format.kind} {self.path}: the tensor {name} was altered; expected the "
                    f"bytes that were written; copy it again, or {self.format.remedy}"
                )

    @contextmanager
    def contents(self) -> Iterator[None]:
        """Errors about the file's contents, raised where these are used, name the file.

        Any DeepringError becomes a FileError; a FileError that names the file stays as it is.
        """
        with _named(self.path, self.format, self.format.remedy):
            yield


def write_sealed(
    path: Path | str, format: SealedFormat[H], header: H, tensors: "Mapping[str, Tensor]"
) -> str:
    """Write a file, whole or not at all, with a new file's usual permissions.

    Equal contents make equal bytes. Returns the digest, as `Sealed` has it. Raises FileError for
    what the format has no place for, and where the file cannot be written.
    """
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    path = Path(path)
    whole = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with _named(path, format, "nothing was written"):
        check_tensors(whole, format.tensors)
        text = _header_text(format, header, whole)
    digest = _sha256(text.encode())
    with replacing(path) as temporary:
        temporary.touch()
        usual = temporary.stat().st_mode
        try:
            save_file(whole, temporary, {_KEY: f"{digest}\n{text}"})
        except SafetensorError as error:
            raise FileError(
                f"{path}: cannot be written; expected a disk with room for it"
            ) from error
        temporary.chmod(usual)  # safetensors leaves it to its owner alone
    return digest


def open_sealed(path: Path | str, format: SealedFormat[H], *, check: bool = False) -> Sealed[H]:
    """Open a file, memory-mapped.

    Everything is verified but the tensors' bytes, which ``check`` reads and verifies as well.
    Raises FileError for a file that is missing, of another kind or version, cut short, altered, or
    with contents that the format does not know.
    """
    path = Path(path)
    if not path.is_file():
        state = "is a folder" if path.is_dir() else "no such file"
        raise FileError(f"{format.kind} {path}: {state}; expected {format.wanted}")
    metadata, tensors = _read(path, format)
    text = _sealed_text(path, format, metadata)
    stated = _stated(path, format, text)
    with _named(path, format, format.remedy):
        listed = typed(_Stated, stated, "header")
        if {name: _type_of(tensor) for name, tensor in tensors.items()} != {
            name: (entry.dtype, entry.shape) for name, entry in listed.tensors.items()
        }:
            raise DataError("other tensors than its header states; expected the same")
        check_tensors(tensors, format.tensors)
        header = typed(format.header, listed.values, "header")
    digests = {name: entry.sha256 for name, entry in listed.tensors.items()}
    opened = Sealed(path, format, header, tensors, _sha256(text.encode()), digests)
    if check:
        opened.verify()
    return opened


@dataclass(frozen=True)
class _TensorEntry:
    dtype: str
    shape: tuple[int, ...]
    sha256: str


@dataclass(frozen=True)
class _Stated:
    """A header as it is written."""

    kind: str
    version: int
    tensors: dict[str, _TensorEntry]
    values: dict[str, Any]


def _header_text(format: SealedFormat[H], header: H, tensors: "Mapping[str, Tensor]") -> str:
    entries = {
        name: _TensorEntry(*_type_of(tensor), _tensor_digest(tensor))
        for name, tensor in tensors.items()
    }
    stated = {
        "kind": format.kind,
        "version": format.version,
        "tensors": entries,
        "values": header,
    }
    try:
        text = json.dumps(stated, sort_keys=True, default=field_values)
    except (TypeError, ValueError) as error:
        raise ConfigError("header: a value that JSON cannot hold; expected plain ones") from error
    typed(format.header, json.loads(text)["values"], "header")
    return text


def _read(path: Path, format: SealedFormat[Any]) -> "tuple[dict[str, str], dict[str, Tensor]]":
    """Metadata and memory-mapped tensors of any safetensors file."""
    from safetensors import safe_open

    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in sorted(file.keys())}
            return file.metadata() or {}, tensors
    except Exception as error:  # the libraries raise many kinds for a damaged file
        raise FileError(
            f"{format.kind} {path}: no whole safetensors file: another file, or cut short or "
            f"altered; expected {format.wanted}; copy it again, or {format.remedy}"
        ) from error


def _sealed_text(path: Path, format: SealedFormat[Any], metadata: Mapping[str, str]) -> str:
    """The header's text, whose seal is whole."""
    if _KEY not in metadata:
        raise FileError(
            f"{format.kind} {path}: written by an earlier version of deepring; expected format "
            f"version {format.version}; {format.remedy}"
            if _BEFORE & set(metadata)
            else f"{format.kind} {path}: a safetensors file that deepring did not write; expected "
            f"{format.wanted}; give such a file"
        )
    digest, _, text = metadata[_KEY].partition("\n")
    if _sha256(text.encode()) != digest:
        raise FileError(
            f"{format.kind} {path}: its header was altered; expected the one that was written; "
            f"copy it again, or {format.remedy}"
        )
    return text


def _stated(path: Path, format: SealedFormat[Any], text: str) -> Any:
    """What the header states, of this kind and version."""
    try:
        stated = json.loads(text)
        kind, version = stated["kind"], stated["version"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileError(
            f"{format.kind} {path}: a header without kind and version; expected {format.wanted}; "
            f"{format.remedy}"
        ) from error
    if kind != format.kind:
        raise FileError(
            f"{format.kind} {path}: a file of the kind {kind!r}; expected {format.wanted}; give "
            "such a file"
        )
    if version != format.version or isinstance(version, bool):
        raise FileError(
            f"{format.kind} {path}: format version {version!r}, expected {format.version}; "
            f"{format.remedy} with this version of deepring"
        )
    return stated


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
