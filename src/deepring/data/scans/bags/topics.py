"""The topics of a bag, and the one with its point clouds."""

from collections import Counter
from collections.abc import Iterable, Mapping

from deepring.data.scans.bags.storage import Contents
from deepring.errors import ConfigError, DataError

CLOUD = "sensor_msgs/msg/PointCloud2"

#: Messages of each topic and type.
Topics = Mapping[tuple[str, str], int]

_LISTED = 20


def topics_of(contents: Iterable[Contents]) -> Topics:
    """The topics of all files of a bag together."""
    topics: Counter[tuple[str, str]] = Counter()
    for part in contents:
        for number, channel in part.channels.items():
            topics[channel.topic, channel.type] += part.counts.get(number, 0)
    return topics


def listing(topics: Topics) -> str:
    """The topics in words."""
    words = [
        f"{topic} ({kind or 'no type'}, {messages} message{'s' * (messages != 1)})"
        for (topic, kind), messages in sorted(topics.items())
    ]
    rest = [f"{len(words) - _LISTED} more"] if len(words) > _LISTED else []
    return ", ".join(words[:_LISTED] + rest) or "none"


def cloud_topic(topics: Topics, topic: str | None) -> str:
    """The named topic, or the only one with point clouds.

    Raises:
        DataError: no topic with point clouds, or one without messages.
        ConfigError: another topic, or several and none named.
    """
    clouds = sorted(name for name, kind in topics if kind == CLOUD)
    if not clouds:
        raise DataError(
            f"no point clouds among its topics, {listing(topics)}; expected one of type {CLOUD}"
        )
    if topic is None and len(clouds) > 1:
        raise ConfigError(
            f"point clouds on {', '.join(clouds)}; expected one topic: name it", argument="topic"
        )
    if topic is not None and topic not in clouds:
        kinds = sorted(kind for name, kind in topics if name == topic)
        found = f" but {', '.join(kinds)}" if kinds else ""
        raise ConfigError(
            f"no point clouds{found} on topic {topic}; expected {' or '.join(clouds)}",
            argument="topic",
        )
    name = topic or clouds[0]
    if not topics[name, CLOUD]:
        raise DataError(
            f"topic {name} has no messages; expected point clouds. The bag holds {listing(topics)}"
        )
    return name
