"""Numbers in text files: what Python writes is read, and nothing else."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.io.numbers_as_text import real_number, whole_number


@settings(derandomize=True)
@given(st.floats(), st.integers(-(2**63) + 1, 2**63 - 1))
def test_what_is_written_is_read(real, whole):
    assert whole_number(str(whole)) == whole
    read = real_number(repr(real))
    assert read == real or (math.isnan(read) and math.isnan(real))


@pytest.mark.parametrize(
    "text", ["", " 1", "1 ", "1_0", "٣", "½", "0x10", "1e", "infinity", "1" * 20]
)
def test_what_is_not_written_is_refused(text):
    with pytest.raises(ValueError, match="no whole number"):
        whole_number(text)
    if not text.isascii() or not text.isdigit():
        with pytest.raises(ValueError, match="no number"):
            real_number(text)
