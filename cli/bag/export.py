"""`bag export`: a recording as tables."""

from pathlib import Path
from typing import Annotated, Any

import msgspec

from cli import output
from cli.bag.info import Recording
from cli.declare import Opt
from cli.options import Options
from services.runtime.errors import Invalid, UsageError
from services.runtime.params.names import flatten
from services.runtime.recording.reader import Bag, Recorded

_TIME = "unix_time"
"""The first column: when the message came, s."""


def export(
    options: Options,
    file: Recording,
    csv: Annotated[bool, Opt("As CSV, a file for each key.")] = False,
    folder: Annotated[
        Path | None, Opt("Where to (default: FILE without its ending).", ("-o", "--output"))
    ] = None,
) -> None:
    """Write a recording as tables, with a column for each field, as position.x.

    Numbers are written so that they read back the same.

    Example: quadctl bag export flight.mcap --csv
    """
    if not csv:
        raise UsageError("as what? CSV is what there is", "quadctl bag export FILE --csv")
    where = folder or file.with_suffix("")
    columns = _columns(file)
    counts = _write(file, where, columns)
    paths = {key: str(_path(where, key)) for key in counts}
    if options.json:
        rows = [{"key": key, "file": paths[key], "rows": count} for key, count in counts.items()]
        output.document({"file": str(file), "tables": rows})
        return
    output.table((paths[key], f"{count} rows") for key, count in counts.items())


def _columns(file: Path) -> dict[str, list[str]]:
    """The fields of each key, in the order in which they first come."""
    found: dict[str, dict[str, None]] = {}
    for message in _messages(Bag(file)):
        found.setdefault(message.key, {}).update(dict.fromkeys(_cells(message)))
    return {key: list(names) for key, names in found.items()}


def _write(file: Path, where: Path, columns: dict[str, list[str]]) -> dict[str, int]:
    import csv
    from contextlib import ExitStack

    counts = dict.fromkeys(columns, 0)
    try:
        where.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            tables = {}
            for key, names in columns.items():
                out = _path(where, key).open("x", encoding="utf-8", newline="")
                tables[key] = csv.writer(stack.enter_context(out))
                tables[key].writerow((_TIME, *names))
            for message in _messages(Bag(file)):
                cells = _cells(message)
                row = (cells.get(name, "") for name in columns[message.key])
                tables[message.key].writerow((_seconds(message.at), *row))
                counts[message.key] += 1
    except FileExistsError as error:
        raise Invalid(
            f"{error.filename} is there already", "name another folder with -o, or remove it"
        ) from error
    except OSError as error:
        raise Invalid(
            f"{where} cannot be written: {error.strerror}", "name a place that you may write to"
        ) from error
    return counts


def _messages(bag: Bag) -> Any:
    """Those that have fields and were on the bus."""
    for message in bag.messages():
        if not message.derived and isinstance(message.value, dict):
            yield message


def _cells(message: Recorded) -> dict[str, Any]:
    return {name: _cell(value) for name, value in flatten(message.value)}


def _cell(value: Any) -> Any:
    """Numbers and texts as they are, what has parts as JSON."""
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, dict | list | bool) or value is None:
        return msgspec.json.encode(value).decode()
    return value


def _seconds(nanoseconds: int) -> str:
    """All digits; a float has not enough of them for the time of day."""
    return f"{nanoseconds // 10**9}.{nanoseconds % 10**9:09d}"


def _path(where: Path, key: str) -> Path:
    return where / f"{key.replace('/', '.')}.csv"
