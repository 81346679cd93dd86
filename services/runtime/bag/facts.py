"""What a recording holds: by its index, or where it has none, counted."""

from pathlib import Path

from mcap.records import Channel, Schema
from msgspec import Struct

from services.runtime.bag import reader, writer
from services.runtime.bag.reader import Bag

_PREFIX = "quadctl."


class KeyFacts(Struct, frozen=True):
    """What came on one key: of which type or encoding, how many, and how many a second."""

    key: str
    type: str
    encoding: str
    messages: int
    hz: float
    derived: bool


class BagFacts(Struct, frozen=True):
    """A recording as a whole.

    `begin` and `end` are Unix times, s; `cut` says why it is not whole, and is empty where it is.
    """

    file: str
    bytes: int
    cut: str
    begin: float
    end: float
    seconds: float
    messages: int
    keys: list[KeyFacts]
    notes: dict[str, dict[str, str]]


def facts(path: Path) -> BagFacts:
    """What a file holds; raises Invalid where it is no recording."""
    return _indexed(path) or _counted(path)


def _indexed(path: Path) -> BagFacts | None:
    found = reader.summary(path)
    if found is None or found.statistics is None:
        return None
    said = found.statistics
    rows = [
        (channel, found.schemas.get(channel.schema_id), said.channel_message_counts.get(number, 0))
        for number, channel in found.channels.items()
    ]
    notes = reader.notes(path)
    return _facts(path, "", said.message_start_time, said.message_end_time, rows, notes)


def _counted(path: Path) -> BagFacts:
    bag, counts = Bag(path), dict[int, int]()
    rows: dict[int, tuple[Channel, Schema | None]] = {}
    begin = end = 0
    for message in bag.messages():
        number = message.channel.id
        rows[number] = (message.channel, message.schema)
        counts[number] = counts.get(number, 0) + 1
        begin, end = min(begin or message.at, message.at), max(end, message.at)
    counted = [(channel, schema, counts[number]) for number, (channel, schema) in rows.items()]
    return _facts(path, bag.cut, begin, end, counted, bag.notes)


def _facts(
    path: Path,
    cut: str,
    begin: int,
    end: int,
    rows: list[tuple[Channel, Schema | None, int]],
    notes: dict[str, dict[str, str]],
) -> BagFacts:
    seconds = (end - begin) / 1e9
    keys = [
        KeyFacts(
            channel.topic,
            schema.name.removeprefix(_PREFIX) if schema else "",
            channel.metadata.get(writer.SAID, channel.message_encoding),
            count,
            (count - 1) / seconds if seconds and count > 1 else 0.0,
            writer.DERIVED in channel.metadata,
        )
        for channel, schema, count in rows
    ]
    keys.sort(key=lambda each: (each.derived, each.key))
    messages = sum(each.messages for each in keys if not each.derived)
    size = path.stat().st_size
    return BagFacts(str(path), size, cut, begin / 1e9, end / 1e9, seconds, messages, keys, notes)
