"""What the viewer is given, with a stand-in for the few functions of rerun, and with rerun itself
where it is installed."""

import sys
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from deepring.errors import ConfigError, FileError
from deepring.reports.scene import BLUE, GREEN, Lines, Points, Scene
from deepring.reports.viewer import expect_display, rerun, save_view, view

SCENE = Scene(
    "a scene\x1b",
    [
        Lines("path", [np.array([[1000.5, 0, 0], [1001, 0, 0.0]])], BLUE, 0.1),
        Points("scan", np.array([[1002.0, 3, 4]]), GREEN, 0.5, ["a\x1b"], 7),
        Points("map", np.array([[1000.0, 0, 0]]), np.array([[1, 2, 3]], np.uint8), 0.5),
    ],
    np.array([1000.0, 0.0, 0.0]),
)


class Stream:
    """Remembers what it is told."""

    made: ClassVar[list] = []

    def __init__(self, application):
        self.application, self.logged, self.calls, self.time = application, {}, [], None
        Stream.made.append(self)

    def set_time(self, timeline, *, sequence):
        self.time = (timeline, sequence)

    def log(self, path, value, *, static):
        self.logged[path] = (value, static, None if static else self.time)

    def save(self, path):
        self.calls.append("save")
        path.write_bytes(b"written")

    def spawn(self):
        self.calls.append("spawn")

    def flush(self):
        self.calls.append("flush")

    def disconnect(self):
        self.calls.append("disconnect")


@pytest.fixture
def library(monkeypatch):
    def shape(kind):
        return lambda data, **rest: (kind, data, rest)

    fake = SimpleNamespace(
        RecordingStream=type("Fresh", (Stream,), {}),
        Points3D=shape("points"),
        LineStrips3D=shape("lines"),
        TextDocument=lambda text: text,
    )
    monkeypatch.setattr(Stream, "made", [])
    monkeypatch.setitem(sys.modules, "rerun", fake)
    return fake


def test_a_file_holds_every_shape_near_the_origin(library, tmp_path):
    save_view(SCENE, tmp_path / "a.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    (stream,) = Stream.made
    assert stream.calls == ["save", "flush", "disconnect"]
    assert stream.application == r"deepring: a scene\x1b"
    (kind, strips, _), static, _ = stream.logged["path"]
    assert (kind, static) == ("lines", True)
    np.testing.assert_array_equal(strips[0], [[0.5, 0, 0], [1, 0, 0]])
    assert strips[0].dtype == np.float32
    (kind, points, rest), static, time = stream.logged["scan"]
    assert (kind, static, time) == ("points", False, ("scan", 7))
    np.testing.assert_array_equal(points, [[2, 3, 4]])
    assert rest["labels"] == [r"a\x1b"]
    assert stream.logged["map"][1]
    assert "x 1000, y 0" in stream.logged["origin"][0]


def test_the_viewer_is_opened_and_one_that_does_not_start_is_said(library, monkeypatch):
    view(SCENE)
    (stream,) = Stream.made
    assert stream.calls == ["spawn", "flush"]
    assert len(stream.logged) == 4

    def broken(self):
        raise RuntimeError("no such program")

    monkeypatch.setattr(Stream, "spawn", broken)
    with pytest.raises(ConfigError, match="the viewer did not start") as told:
        view(SCENE)
    assert "no such program" not in str(told.value)


def test_a_file_is_whole_or_absent(library, tmp_path, monkeypatch):
    def broken(self, path, value, *, static):
        raise KeyboardInterrupt

    monkeypatch.setattr(Stream, "log", broken)
    with pytest.raises(KeyboardInterrupt):
        save_view(SCENE, tmp_path / "a.rrd")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match=r"a\.rrd: cannot be written"):
        save_view(SCENE, tmp_path / "file" / "a.rrd")


def test_what_is_missing_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"^view: .*pip install 'deepring\[view\]'$"):
        rerun()
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ConfigError, match="no display"):
        expect_display()
    monkeypatch.setenv("DISPLAY", ":0")
    expect_display()


def test_rerun_itself_writes_the_file(tmp_path):
    pytest.importorskip("rerun", reason="needs deepring[view], 170 MB")
    save_view(SCENE, tmp_path / "a.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    written = (tmp_path / "a.rrd").read_bytes()
    assert written.startswith(b"RRF2")
    for path in (b"/path", b"/scan", b"/map", b"/origin"):
        assert path in written
