"""LZF decompression as a compiled loop (numba). Imported on first use."""

from typing import no_type_check

from numba import njit


@njit(cache=True, nogil=True)
@no_type_check  # numba compiles what is written here, not a wrapper that checks arguments
def unpack(packed, out):
    """Decompress ``packed`` into ``out``, both uint8; False unless both end together.

    A control byte below 32 is followed by that many bytes and one more, which are copied. Others
    refer back: length - 2 in the upper three bits, or in the next byte plus 7 if these are all
    set, and distance - 1 in the lower five bits and one byte.
    """
    i, o, end, size = 0, 0, len(packed), len(out)
    while i < end:
        control = int(packed[i])
        i += 1
        if control < 32:
            length = control + 1
            if i + length > end or o + length > size:
                return False
            for k in range(length):
                out[o + k] = packed[i + k]
            i += length
        else:
            length = control >> 5
            if length == 7:
                if i >= end:
                    return False
                length += int(packed[i])
                i += 1
            length += 2
            if i >= end:
                return False
            start = o - ((control & 31) << 8) - int(packed[i]) - 1
            i += 1
            if start < 0 or o + length > size:
                return False
            for k in range(length):  # byte by byte: source and target may overlap
                out[o + k] = out[start + k]
        o += length
    return o == size
