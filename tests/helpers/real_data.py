"""Real scans, which are not part of the repository: tests of them are skipped where they lack."""

import os
from pathlib import Path

import pytest

#: The folder of the real scans: that of DEEPRING_TEST_DATA, or ``shared/data`` beside the checkout.
FOLDER = Path(
    os.environ.get("DEEPRING_TEST_DATA")
    or Path(__file__).resolve().parents[2].parent / "shared" / "data"
)


def real_data(*parts: str) -> Path:
    """A file or folder of the real scans; skips the test where it is not there."""
    path = FOLDER.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{path} is not there; DEEPRING_TEST_DATA names the folder of the real scans")
    return path
