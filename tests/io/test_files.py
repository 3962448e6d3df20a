"""A file appears whole or not at all."""

from pathlib import Path

import pytest

from deepring.errors import FileError
from deepring.io.files import cut_short, part_of, replacing, write_together, write_whole


def test_a_new_file_takes_the_place_of_the_old_one_at_the_end(tmp_path):
    path = tmp_path / "new" / "folder" / "a.txt"
    write_whole(path, [b"first, ", b"whole"])
    assert path.read_bytes() == b"first, whole"
    with replacing(path) as temporary:
        temporary.write_text("second")
        assert temporary == part_of(path)
        assert path.read_bytes() == b"first, whole"
    assert path.read_text() == "second"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OSError])
def test_whatever_is_raised_leaves_the_old_file_alone(tmp_path, error):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def chunks():
        yield b"half"
        raise error

    with pytest.raises(FileError if error is OSError else error):
        write_whole(path, chunks())
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_kill_left_behind_is_replaced(tmp_path):
    path = tmp_path / "a.txt"
    part_of(path).write_text("left by a process that was killed")
    write_whole(path, [b"whole"])
    assert path.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [path]


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    for path in (tmp_path / "file" / "a.txt", tmp_path):
        with pytest.raises(FileError, match=r"cannot be written .* expected a writable path"):
            write_whole(path, [b"x"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_files_that_belong_together_appear_together(tmp_path):
    texts = {tmp_path / "a.txt": "first", tmp_path / "b.txt": "zweite, größer"}
    write_together(texts)
    assert {path: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == texts
    assert not cut_short(texts)


def test_a_kill_between_files_that_belong_together_is_seen(tmp_path, monkeypatch):
    class Killed(BaseException):
        pass

    def killed(*_):
        raise Killed

    texts = {tmp_path / "a.txt": "first", tmp_path / "b.txt": "second"}
    replace, unlink = Path.replace, Path.unlink

    def one(path, target):
        monkeypatch.setattr(Path, "replace", killed)
        monkeypatch.setattr(Path, "unlink", lambda _: None)  # nothing runs after a kill
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", one)
    with pytest.raises(Killed):
        write_together(texts)
    assert sum(path.exists() for path in texts) == 1
    assert cut_short(texts)
    monkeypatch.setattr(Path, "replace", replace)
    monkeypatch.setattr(Path, "unlink", unlink)
    write_together(texts)
    assert {path: path.read_text() for path in tmp_path.iterdir()} == texts
    assert not cut_short(texts)
