"""LZF: literal runs, and references to what was decompressed before."""

from fuzz.files import UndecodableError


def decompress(data: bytes, size: int) -> bytes:
    """The ``size`` bytes that a stream stands for."""
    out = bytearray()
    at = 0
    while at < len(data):
        control = data[at]
        at += 1
        if control < 32:
            run = data[at : at + control + 1]
            if len(run) < control + 1:
                raise UndecodableError("an LZF stream cut short")
            out += run
            at += control + 1
        else:
            length = control >> 5
            if length == 7:
                if at >= len(data):
                    raise UndecodableError("an LZF stream cut short")
                length += data[at]
                at += 1
            if at >= len(data):
                raise UndecodableError("an LZF stream cut short")
            back = ((control & 31) << 8) + data[at] + 1
            at += 1
            if back > len(out):
                raise UndecodableError("an LZF reference before the beginning")
            for _ in range(length + 2):
                out.append(out[-back])
        if len(out) > size:
            raise UndecodableError("more bytes than an LZF stream's header says")
    if len(out) != size:
        raise UndecodableError("fewer bytes than an LZF stream's header says")
    return bytes(out)


def compress(data: bytes) -> bytes:
    """A stream of runs and of short references, to have both in good files."""
    out, run = bytearray(), bytearray()
    seen: dict[bytes, int] = {}
    at = 0

    def flush() -> None:
        for start in range(0, len(run), 32):
            piece = run[start : start + 32]
            out.append(len(piece) - 1)
            out.extend(piece)
        run.clear()

    while at < len(data):
        key = data[at : at + 3]
        before = seen.get(key)
        seen[key] = at
        if before is None or len(key) < 3 or at - before > 8192:
            run.append(data[at])
            at += 1
            continue
        length = 3
        while (
            length < 264 and at + length < len(data) and data[before + length] == data[at + length]
        ):
            length += 1
        flush()
        back = at - before - 1
        short = length - 2
        if short < 7:
            out.append((short << 5) | (back >> 8))
        else:
            out.append((7 << 5) | (back >> 8))
            out.append(short - 7)
        out.append(back & 255)
        at += length
    flush()
    return bytes(out)
