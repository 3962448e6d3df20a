"""Real data for tests: in the folder DEEPRING_TEST_DATA, or ../shared/data beside the checkout."""

import os
from pathlib import Path

import pytest

_BESIDE = Path(__file__).parents[2].parent / "shared" / "data"


def real_data(*parts: str) -> Path:
    """A file or folder of the real data; the test is skipped, with the reason, without it."""
    path = Path(os.environ.get("DEEPRING_TEST_DATA", _BESIDE)).joinpath(*parts)
    if not path.exists():
        pytest.skip(f"no real data at {path}; DEEPRING_TEST_DATA names their folder")
    return path
