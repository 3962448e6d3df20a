"""What all figures share: no window, no global state, files written whole."""

import errno
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib import image

import deepring.reports
from deepring.errors import DeepringError
from deepring.reports.style import PALETTE, new_figure, png, save, series, style_axes

SOURCES = sorted(Path(deepring.reports.__file__).parent.glob("*.py"))
FIGURES = ("curves", "sinograms", "style", "trajectory_figure")


def drawn():
    figure = new_figure(3.0, 2.0)
    style_axes(figure.add_subplot(), "title", "across", "up")
    return figure


def test_save_writes_a_png_of_the_asked_size_and_creates_folders(tmp_path):
    path = tmp_path / "new" / "folder" / "figure.png"
    save(drawn(), path, dpi=100)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert image.imread(path).shape[:2] == (200, 300)
    assert list(path.parent.iterdir()) == [path], "no temporary file stays behind"


def test_a_failed_save_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")
    figure = drawn()

    def half(target, **_):
        target.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "a system's words")

    monkeypatch.setattr(figure, "savefig", half)
    with pytest.raises(DeepringError, match="no space is left on the disk"):
        save(figure, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_series_of_the_first_twenty_one_are_distinct():
    assert len({series(index) for index in range(3 * len(PALETTE))}) == 3 * len(PALETTE)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_no_module_names_pyplot(path):
    assert "pyplot" not in path.read_text(encoding="utf-8")


def test_figures_are_written_without_a_display_whatever_backend_is_asked_for(tmp_path):
    script = (
        "import warnings\n"
        "warnings.simplefilter('error')\n"
        # of matplotlib 3.8 about pyparsing
        "warnings.filterwarnings('ignore', r\"'\\w+' deprecated - use\", DeprecationWarning)\n"
        f"from deepring.reports import {', '.join(FIGURES)}\n"
        f"style.save(style.new_figure(1, 1), {str(tmp_path / 'figure.png')!r})"
    )
    environment = {"PATH": "", "MPLBACKEND": "TkAgg", "HOME": str(tmp_path)}
    run = subprocess.run(
        [sys.executable, "-c", script],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "figure.png").exists()


@pytest.mark.parametrize("text", ["$x^{", "a $ b $ c", r"$\\alpha$", "a_^%#&"])
def test_names_are_no_formulas(text, tmp_path):
    figure = new_figure(3, 2)
    axes = figure.add_subplot()
    axes.plot([0, 1], label=text)
    axes.legend()
    axes.set_xticks([0, 1], [text, text])
    style_axes(axes, text, text, text)
    save(figure, tmp_path / "a.png")
    assert png(figure).startswith(b"\x89PNG")
