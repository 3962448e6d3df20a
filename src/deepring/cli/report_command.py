"""`deepring report`: a run, a sweep or a comparison as one HTML page."""

import argparse
import logging
from pathlib import Path

from deepring.checks import one_of
from deepring.cli.console import console
from deepring.cli.json_output import show_written
from deepring.cli.options import expect_new, expect_writable
from deepring.evaluation.metrics import Over
from deepring.experiment.report import report
from deepring.io.files import write_whole

log = logging.getLogger(__name__)

#: The page of a folder.
PAGE = "report.html"

#: Bytes above which a page is called large.
LARGE = 5_000_000


def report_command(args: argparse.Namespace) -> None:
    """Write the page, by default to FOLDER/report.html, which is replaced."""
    if args.output is not None:
        expect_new(args.output)
    path = args.output or args.folder / PAGE
    expect_writable(path)
    over = None if args.over is None else one_of("over", args.over, Over)
    page = report(args.folder, args.pictures, args.radius, over, mix=args.mix, beside=path.parent)
    if (size := write_page(path, page)) > LARGE:
        log.warning("%s: %.1f MB; fewer --pictures make it smaller", path, size / 1e6)
    show_written(args, [path], lambda: console.print(f"written      {path}"))


def write_page(path: Path, page: str) -> int:
    """Write a page in one step, and return its size in bytes; a page that is there is replaced."""
    content = page.encode("utf-8", "backslashreplace")
    write_whole(path, [content])
    return len(content)
