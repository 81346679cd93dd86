"""`bag info`, `check`, `repair` and `export`."""

import os
import time
from pathlib import Path
from typing import Annotated, Any

import msgspec

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.services.runtime.files import already_exists
from quadctl.services.runtime.params.names import flatten
from quadctl.services.runtime.recording import verify as mending
from quadctl.services.runtime.recording.reader import Bag, KeyFacts, Recorded, facts
from quadctl.services.runtime.recording.verify import check as look_through

Recording = Annotated[Path, Arg("A recording, MCAP.", "FILE")]


def info(options: Options, file: Recording) -> None:
    """Show the contents of a recording; of a cut one, all that is left.

    Example: quadctl bag info flight.mcap
    """
    found = facts(file)
    if options.json:
        output.document({"ok": not found.cut, **msgspec.to_builtins(found)})
        return
    began = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(found.begin))
    output.table(
        [
            ("File:", found.file),
            ("Size:", f"{found.bytes / 1e6:.2f} MB"),
            ("Began:", began if found.messages else "-"),
            ("Length:", f"{found.seconds:.1f} s"),
            ("Messages:", str(found.messages)),
        ]
    )
    if found.keys:
        output.table([("KEY", "TYPE", "MESSAGES", "HZ"), *map(_row, found.keys)])
    if found.cut:
        output.note(f"it is cut: {found.cut}\n  try: `quadctl bag repair {file}` repairs it")


def _row(key: KeyFacts) -> tuple[str, str, str, str]:
    what = key.type or key.encoding
    name = f"{key.key} (for viewers)" if key.derived else key.key
    return name, what, str(key.messages), f"{key.hz:.1f}" if key.hz else "-"


def check(options: Options, file: Recording) -> None:
    """Check every message against its schema and look for gaps; exit 8 if there is a fault.

    Example: quadctl bag check flight.mcap
    """
    found = look_through(file)
    ok = not found.faults
    if options.json:
        content = {"messages": found.messages, "faults": found.faults}
        output.document({"ok": ok, "file": str(file), **content})
    else:
        for fault in found.faults:
            output.line(f"FAIL  {fault}")
        verdict = "no faults" if ok else "faulty; `quadctl bag repair` repairs a cut recording"
        output.line(f"{file}: {found.messages} messages, {verdict}")
    output.end(ok=ok)


def repair(
    options: Options,
    file: Recording,
    target: Annotated[
        Path | None, Option("Output file; FILE stays unchanged.", ("-o", "--output"))
    ] = None,
) -> None:
    """Repair a recording that was cut by kill -9, a full disk or a partial copy.

    All complete chunks are kept; a killed recorder has lost at most half a second.

    Example: quadctl bag repair flight.mcap
    """
    fresh = target or file.with_name(f".{file.name}.{os.getpid()}")
    try:
        done = mending.repair(file, fresh)
        if target is None:
            fresh.replace(file)
    except FileExistsError as error:
        raise already_exists(fresh) from error
    except OSError as error:
        raise QuadctlError(
            f"{fresh} cannot be written: {error.strerror}", "free space, or name another file: -o"
        ) from error
    result = {"file": str(target or file), "messages": done.messages, "dropped_bytes": done.dropped}
    kept = f"{done.messages} messages kept, {done.dropped} bytes of an incomplete end dropped"
    text = (
        f"{target or file}: {kept}" if done.why else f"{file} was whole: {done.messages} messages"
    )
    output.either(options, {**result, "cut": done.why}, text)


_MOST_FIELDS = 1000
"""Columns of a table: each row has all of them, so a small recording could fill any disk."""
_ROWS = 10_000  # rows in memory at a time
_TIME = "unix_time"  # first column: the time (s) at which the message was received


def export(
    options: Options,
    file: Recording,
    csv: Annotated[bool, Option("Write CSV, one file for each key.")] = False,
    folder: Annotated[
        Path | None, Option("Output folder (default: FILE without its ending).", ("-o", "--output"))
    ] = None,
) -> None:
    """Write a recording as tables, with a column for each field, e.g. position.x.

    Numbers read back exactly.

    Example: quadctl bag export flight.mcap --csv
    """
    if not csv:
        raise UsageError("no format is given: CSV is the only one", "quadctl bag export FILE --csv")
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
    """Return the fields of each key, in order of their first appearance."""
    found: dict[str, dict[str, None]] = {}
    for message in _messages(Bag(file)):
        fields = found.setdefault(message.key, {})
        fields.update(dict.fromkeys(_cells(message)))
        if len(fields) > _MOST_FIELDS:
            raise Invalid(
                f"the messages on {message.key!r} have more than {_MOST_FIELDS} different fields",
                "they make no table; `quadctl replay` and MCAP viewers show them",
            )
    return {key: list(names) for key, names in found.items()}


def _write(file: Path, where: Path, columns: dict[str, list[str]]) -> dict[str, int]:
    counts = dict.fromkeys(columns, 0)
    rows = {key: [(_TIME, *names)] for key, names in columns.items()}
    try:
        where.mkdir(parents=True, exist_ok=True)
        _append(where, rows, "x")
        for number, message in enumerate(_messages(Bag(file)), 1):
            cells = _cells(message)
            row = (cells.get(name, "") for name in columns[message.key])
            # All digits: a float has too few for Unix time in ns.
            at = f"{message.at // 10**9}.{message.at % 10**9:09d}"
            rows[message.key].append((at, *row))
            counts[message.key] += 1
            if number % _ROWS == 0:
                _append(where, rows, "a")
        _append(where, rows, "a")
    except FileExistsError as error:
        raise Invalid(
            f"{error.filename} is there already", "name another folder with -o, or remove it"
        ) from error
    except OSError as error:
        raise Invalid(
            f"{where} cannot be written: {error.strerror}", "name a writable folder: -o"
        ) from error
    return counts


def _append(where: Path, rows: dict[str, list[Any]], mode: str) -> None:
    """Write the rows to their tables; one is open at a time, as there may be more keys than files."""
    import csv

    for key, lines in rows.items():
        if lines:
            with _path(where, key).open(mode, encoding="utf-8", newline="") as out:
                csv.writer(out).writerows(lines)
            lines.clear()


def _messages(bag: Bag) -> Any:
    """Yield the messages that have fields and were on the bus."""
    for message in bag.messages():
        if not message.derived and isinstance(message.value, dict):
            yield message


def _cells(message: Recorded) -> dict[str, Any]:
    return {name: _cell(value) for name, value in flatten(message.value)}


def _cell(value: Any) -> Any:
    """Return numbers and texts unchanged, anything else as JSON."""
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, dict | list | bool) or value is None:
        return msgspec.json.encode(value).decode()
    return value


def _path(where: Path, key: str) -> Path:
    return where / f"{key.replace('/', '.').replace(chr(0), '.')}.csv"
