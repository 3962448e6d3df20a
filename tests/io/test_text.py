"""Text files with and without a byte order mark, whatever their line ends."""

import os

import pytest

from deepring.errors import FileError
from deepring.io.text import open_text, read_text

TEXT = "Tr: 1 0 0\nzweite Zeile, ü\n"


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_marks_and_line_ends_make_no_difference(tmp_path, mark, end):
    path = tmp_path / "calib.txt"
    path.write_bytes(mark + TEXT.replace("\n", end).encode())
    assert read_text(path, "Tr") == TEXT
    with open_text(path) as file:
        assert list(file) == TEXT.splitlines(keepends=True)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_utf_16_is_refused_by_its_name(tmp_path, encoding):
    path = tmp_path / "calib.txt"
    path.write_bytes("Tr: 1 0 0\n".encode(encoding))
    with pytest.raises(FileError, match=r"calib\.txt: is UTF-16 text: save it as UTF-8; .*Tr"):
        read_text(path, "Tr")


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"a\0b", b"\x80abc", b"\xff\xfe\x00\xd8"])
def test_other_bytes_are_not_text(tmp_path, content):
    path = tmp_path / "calib.txt"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"calib\.txt: is not text"):
        read_text(path, "Tr")


def test_a_missing_file_is_an_error(tmp_path):
    with pytest.raises(FileError, match=r"none\.txt: cannot be read \(No such file"):
        read_text(tmp_path / "none.txt", "Tr")


def test_a_git_lfs_pointer_is_called_so(tmp_path):
    path = tmp_path / "calib.txt"
    path.write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{0:064d}\nsize 123\n")
    with pytest.raises(FileError, match=r"calib\.txt: is a Git LFS pointer.*; expected Tr"):
        read_text(path, "Tr")


@pytest.mark.parametrize("device", ["/dev/zero", "pipe"])
def test_what_may_have_no_end_is_not_read(tmp_path, device):
    path = tmp_path / device
    if device == "pipe":
        os.mkfifo(path)
    with pytest.raises(FileError, match=r"cannot be read \(a device or a pipe\); expected Tr"):
        read_text(path, "Tr")
    with pytest.raises(OSError, match="a device or a pipe"):
        open_text(path)
