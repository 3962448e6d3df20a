"""SQLite databases of ROS 2, .db3."""

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path

from deepring.data.scans.bags.fields import LARGEST, size_of, text
from deepring.data.scans.bags.storage import Channel, Contents, Message, named_type
from deepring.errors import BrokenScanError, DataError

_MAGIC = b"SQLite format 3\0"
#: What a damaged database raises; its own messages may be no text.
_ERRORS = (sqlite3.Error, UnicodeDecodeError)


class DatabaseFile:
    """One .db3 file. Nothing that its schema defines is run."""

    repair = "sqlite3 FILE .recover"

    def __init__(self, path: Path) -> None:
        self.path = path

    def contents(self) -> Contents:
        """By its tables."""
        _check_size(self.path)
        for journal in ("wal", "journal"):
            beside = self.path.with_name(f"{self.path.name}-{journal}")
            if beside.is_file() and size_of(beside):
                raise DataError(
                    f"{beside.name} beside it holds changes that are not in it: the recording was "
                    f"not closed; open a copy of both with `sqlite3`, which takes them in"
                )
        with closing(self._connect()) as database:
            try:
                _check_tables(database)
                topics = database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                ).fetchall()
                # Through the table, not an index of it, which may be damaged by itself.
                counts = dict(
                    database.execute(
                        "SELECT topic_id, count(*) FROM messages NOT INDEXED GROUP BY topic_id"
                    ).fetchall()
                )
                indexed = _indexed(database)
            except _ERRORS as error:
                raise _damaged() from error
        channels: dict[int, Channel] = {}
        for number, *names in topics:
            if not (isinstance(number, int) and all(isinstance(name, str) for name in names)):
                raise BrokenScanError("its table of topics is damaged")
            name, kind, encoding = (text(name.encode("utf-8", "replace")) for name in names)
            channels[number] = Channel(name, named_type(kind), encoding)
        of_none = sum(counts.values()) - sum(counts.get(number, 0) for number in channels)
        damage = f"{of_none} messages are of no topic" if of_none else ""
        if indexed not in (None, sum(counts.values())):
            damage = f"{sum(counts.values())} messages, but {indexed} in their index"
        return Contents(channels, {n: counts.get(n, 0) for n in channels}, damage)

    def messages(self, channels: Collection[int]) -> Iterator[Message]:
        """See `Container`."""
        wanted = ",".join("?" * len(channels))
        with closing(self._connect()) as database:
            try:
                # In the order that the table states, not an index of it.
                rows = database.execute(
                    "SELECT rowid FROM messages NOT INDEXED "
                    f"WHERE topic_id IN ({wanted}) ORDER BY timestamp, rowid",
                    tuple(channels),
                ).fetchall()
                for row in rows:
                    found = database.execute(
                        "SELECT topic_id, timestamp, data FROM messages WHERE rowid = ?", row
                    ).fetchall()
                    if len(found) != 1:  # one way through the table finds it, another does not
                        raise BrokenScanError("its table of messages is damaged")
                    number, time, data = found[0]
                    if not (isinstance(time, int) and isinstance(data, bytes)):
                        raise BrokenScanError("its table of messages is damaged")
                    yield Message(number, time, data)
            except _ERRORS as error:
                raise _damaged() from error

    def _connect(self) -> sqlite3.Connection:
        database = sqlite3.connect(f"{self.path.absolute().as_uri()}?immutable=1", uri=True)
        database.text_factory = lambda data: data.decode("utf-8", "replace")
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
        database.execute("PRAGMA trusted_schema = OFF")
        # Pages that name each other in circles would be read for ever.
        rounds = iter(range(size_of(self.path) // 1000 + 100))
        database.set_progress_handler(lambda: next(rounds, None) is None, 10_000)
        return database


def _check_size(path: Path) -> None:
    """Raise BrokenScanError unless the file is a database of the size that it states."""
    with path.open("rb") as file:
        header = file.read(100)
    if len(header) < 100 or not header.startswith(_MAGIC):
        raise BrokenScanError("it does not begin as SQLite databases do")
    page = int.from_bytes(header[16:18], "big")
    # The number of pages is valid if it was written by the last that changed the file.
    pages = int.from_bytes(header[28:32], "big") if header[24:28] == header[92:96] else 0
    expected = pages * (65536 if page == 1 else page)
    if (size := size_of(path)) < expected:
        raise BrokenScanError(f"cut short: {size} bytes, but it states {expected}")


def _check_tables(database: sqlite3.Connection) -> None:
    """Raise DataError unless ``topics`` and ``messages`` are tables of stored columns."""
    columns = {"topics": "id name type serialization_format", "messages": "topic_id timestamp data"}
    for table, names in columns.items():
        kinds = database.execute(
            "SELECT type, sql FROM sqlite_master WHERE name = ?", (table,)
        ).fetchall()
        stored = {
            name
            for _, name, _, _, _, _, hidden in database.execute(f"PRAGMA table_xinfo({table})")
            if not hidden
        }
        plain = [kind for kind, _ in kinds] == ["table"] and "VIRTUAL" not in str(
            kinds[0][1]
        ).upper()
        if not plain or not stored >= set(names.split()):
            raise DataError(f"no table {table} with {names.replace(' ', ', ')}; expected a bag")


def _indexed(database: sqlite3.Connection) -> int | None:
    """The number of messages in the index that rosbag2 makes of them; None without it."""
    indexes = {name for _, name, *_ in database.execute("PRAGMA index_list(messages)")}
    if "timestamp_idx" not in indexes:
        return None
    query = "SELECT count(*) FROM messages INDEXED BY timestamp_idx"
    found: int = database.execute(query).fetchone()[0]
    return found


def _damaged() -> BrokenScanError:
    return BrokenScanError("its database is damaged")
