"""Which further columns of the points the datasets of a config lack, such as labels."""

from collections.abc import Sequence

from deepring.data.readers import open_session
from deepring.experiment.config import Config


def lacking_columns(cfg: Config, columns: Sequence[str]) -> dict[str, list[str]]:
    """Those of ``columns`` that some dataset of the config lacks, each with the datasets' names.

    Raises DataError for a session that cannot be opened.
    """
    lacking: dict[str, list[str]] = {}
    nodes = [*cfg.train_data.values(), *cfg.test_data.values()] or [cfg.data]
    for node in {node.name: node for node in nodes}.values():
        sides = [node.database, *([node.query] if node.split == "sessions" else [])]
        for side in sides:
            known = open_session(node.format, node.root, side, **node.reader).columns
            for column in columns:
                if column not in known and node.name not in lacking.get(column, []):
                    lacking.setdefault(column, []).append(node.name)
    return lacking
