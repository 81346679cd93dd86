"""Makes a cut recording whole: what is there is written anew, with an index."""

from pathlib import Path
from typing import NamedTuple

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer

from services.runtime.bag.outfile import Outfile
from services.runtime.bag.reader import Bag


class Repaired(NamedTuple):
    """What came of it: the messages kept, and the bytes at the end that were no whole record."""

    messages: int
    dropped: int
    why: str


def repair(source: Path, target: Path) -> Repaired:
    """Copy all that is whole of a recording into a new file.

    Raises Invalid where the source is no recording, OSError where the target cannot be written;
    then it is not there.
    """
    bag, messages = Bag(source), 0
    records = bag.records()
    first = next(records, None)
    out = Outfile.create(target)
    try:
        mcap = Writer(out)  # type: ignore[arg-type] # all it calls is there
        mcap.start(bag.header.profile, bag.header.library or "quadctl")
        copy = _Copy(mcap)
        if first is not None:
            copy.add(first)
        for record in records:
            messages += isinstance(record, Message)
            copy.add(record)
        mcap.finish()
        out.flush()
    except OSError:
        target.unlink(missing_ok=True)
        raise
    finally:
        out.close()
    return Repaired(messages, source.stat().st_size - bag.read_to if bag.cut else 0, bag.cut)


class _Copy:
    """Records into another file, where their schemas and channels have other numbers."""

    def __init__(self, mcap: Writer) -> None:
        self._mcap = mcap
        self._schemas, self._channels = {0: 0}, dict[int, int]()

    def add(self, record: object) -> None:
        """Write a record, unless it stands there already."""
        mcap = self._mcap
        match record:
            case Schema() if record.id not in self._schemas:
                number = mcap.register_schema(record.name, record.encoding, record.data)
                self._schemas[record.id] = number
            case Channel() if record.id not in self._channels:
                schema = self._schemas[record.schema_id]
                self._channels[record.id] = mcap.register_channel(
                    record.topic, record.message_encoding, schema, record.metadata
                )
            case Message():
                mcap.add_message(
                    self._channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
            case Metadata():
                mcap.add_metadata(record.name, record.metadata)
            case Attachment():
                mcap.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )
