"""`bag info`, `check`, `repair` and `export`."""

import time
from collections import Counter
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import msgspec

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.files import already_exists, refuse_existing, unwritable
from quadctl.services.runtime.params.names import flatten
from quadctl.services.runtime.recording import verify as mending
from quadctl.services.runtime.recording.reader import (
    STILL_RECORDED,
    Bag,
    KeyFacts,
    Recorded,
    facts,
)
from quadctl.services.runtime.recording.verify import check as look_through

Recording = Annotated[Path, Arg("A recording, MCAP.", "FILE")]


def info(options: Options, file: Recording) -> None:
    """Show the contents of a recording; of a cut or damaged one, all that can be read.

    Example: quadctl bag info flight.mcap
    """
    found = facts(file)
    if options.json:
        output.document({"ok": not found.problem, **msgspec.to_builtins(found)})
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
    if found.missing:
        output.note(f"{found.missing} messages that its index counts cannot be read")
    if found.problem:
        recorded = found.cut == STILL_RECORDED
        hint = "end its recorder first" if recorded else f"`quadctl bag repair {file}` repairs it"
        output.note(f"it is {found.problem}\n  try: {hint}")


def _row(key: KeyFacts) -> tuple[str, str, str, str]:
    what = key.type or key.encoding
    name = f"{key.key} (for viewers)" if key.derived else key.key
    return name, what, str(key.messages), f"{key.hz:.1f}" if key.hz else "-"


def check(options: Options, file: Recording) -> None:
    """Check every message against its schema and look for gaps; exit 8 if there is a fault.

    Messages of other encodings, e.g. cdr of ROS 2, are counted: their schemas are not checked.

    Example: quadctl bag check flight.mcap
    """
    found = look_through(file)
    ok = not found.faults
    if options.json:
        output.document({"ok": ok, "file": str(file), **found._asdict()})
    else:
        for fault in found.faults:
            output.line(f"FAIL  {fault}")
        for encoding, count in found.unchecked.items():
            output.line(f"-     {count} messages are encoded as {encoding}: not checked")
        hint = "; `quadctl bag repair` keeps what can be read" if found.repairable else ""
        verdict = "no faults" if ok else f"faulty{hint}"
        output.line(f"{file}: {found.messages} messages, {verdict}")
    output.end(ok=ok)


def repair(
    options: Options,
    file: Recording,
    target: Annotated[
        Path | None, Option("Output file; FILE stays unchanged.", ("-o", "--output"))
    ] = None,
) -> None:
    """Repair a recording that was cut by kill -9, a full disk or a partial copy, or damaged.

    All that can be read is kept; a killed recorder has lost at most half a second. FILE keeps its
    links, owner and mode. If it is damaged inside, it stays beside the new one, as FILE.damaged.

    Example: quadctl bag repair flight.mcap
    """
    try:
        done = mending.repair_in_place(file) if target is None else mending.repair(file, target)
    except FileExistsError as error:
        raise already_exists(Path(error.filename)) from error
    except OSError as error:
        raise unwritable(target or file, error) from error
    original = done.original and str(done.original)
    result = {"file": str(target or file), **done._asdict(), "original": original}
    if not done.why:
        text = f"{file} was whole: {done.messages} messages"
    else:
        text = (
            f"{target or file}: {done.messages} messages kept, {done.dropped} bytes cannot be read"
        )
        text += f"\n{file} was {done.why}"
        text += f"\nthe file of before is {original}" if original else ""
    output.either(options, result, text)


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
    force: Annotated[bool, Option("Overwrite tables that are there.")] = False,
) -> None:
    """Write a recording as tables, with a column for each field, e.g. position.x.

    Numbers read back exactly. A key's file has its name with dots for slashes, and %XX for
    what no file name may hold.

    Example: quadctl bag export flight.mcap --csv
    """
    if not csv:
        raise UsageError("no format is given: CSV is the only one", "quadctl bag export FILE --csv")
    where = folder or file.with_suffix("")
    bag = Bag(file)
    columns, left_out = _columns(bag)
    if left_out and not columns:
        raise Invalid(
            f"{file} has nothing that makes a table: {_named(left_out)}",
            "MCAP viewers show it; `quadctl bag info` lists its keys",
        )
    paths = _paths(where, columns)
    counts = _write(file, where, paths, columns, force=force)
    if left_out:
        output.note(f"no tables: {_named(left_out)}")
    if bag.problem:
        output.note(f"{file} is {bag.problem}")
    if options.json:
        rows = [
            {"key": key, "file": str(paths[key]), "rows": count} for key, count in counts.items()
        ]
        document = {"file": str(file), "tables": rows, "left_out": left_out}
        output.document({**document, "problem": bag.problem})
        return
    output.table((str(paths[key]), f"{count} rows") for key, count in counts.items())


def _named(left_out: dict[str, int]) -> str:
    most = 5
    names = [f"{count} messages on {key}" for key, count in left_out.items()]
    more = [f"{len(names) - most} more keys"] if len(names) > most else []
    return ", ".join(names[:most] + more) + " (no fields that can be read)"


def _columns(bag: Bag) -> tuple[dict[str, list[str]], dict[str, int]]:
    """Return the fields of each key, in order of their first appearance, and messages without any."""
    found: dict[str, dict[str, None]] = {}
    left_out = Counter[str]()
    for message in bag.messages():
        if message.derived:
            continue
        if (cells := _cells(message)) is None:
            left_out[message.key] += 1
            continue
        fields = found.setdefault(message.key, {})
        fields.update(dict.fromkeys(cells))
        if len(fields) > _MOST_FIELDS:
            raise Invalid(
                f"the messages on {message.key!r} have more than {_MOST_FIELDS} different fields",
                "they make no table; `quadctl replay` and MCAP viewers show them",
            )
    return {key: list(names) for key, names in found.items()}, dict(left_out)


def _write(
    file: Path, where: Path, paths: dict[str, Path], columns: dict[str, list[str]], *, force: bool
) -> dict[str, int]:
    counts = dict.fromkeys(columns, 0)
    rows = {paths[key]: [(_TIME, *names)] for key, names in columns.items()}
    try:
        where.mkdir(parents=True, exist_ok=True)
        for path in paths.values():
            refuse_existing(path, force=force)
        _append(rows, "w")
        for number, message in enumerate(Bag(file).messages(), 1):
            if message.derived or (cells := _cells(message)) is None:
                continue
            row = (cells.get(name, "") for name in columns[message.key])
            # All digits: a float has too few for Unix time in ns.
            at = f"{message.at // 10**9}.{message.at % 10**9:09d}"
            rows[paths[message.key]].append((at, *row))
            counts[message.key] += 1
            if number % _ROWS == 0:
                _append(rows, "a")
        _append(rows, "a")
    except OSError as error:
        for path in () if force else paths.values():
            path.unlink(missing_ok=True)
        with suppress(OSError):  # other files are in it
            where.rmdir()
        raise unwritable(Path(error.filename or where), error) from error
    return counts


def _append(rows: dict[Path, list[Any]], mode: str) -> None:
    """Write the rows to their tables; one is open at a time, as there may be more keys than files."""
    import csv

    for path, lines in rows.items():
        if lines:
            with path.open(mode, encoding="utf-8", newline="") as out:
                csv.writer(out).writerows(lines)
            lines.clear()


def _cells(message: Recorded) -> dict[str, Any] | None:
    """Return the fields of a message that has any."""
    value = message.value
    if not isinstance(value, dict):
        return None
    return {name: _cell(each) for name, each in flatten(value)}


def _cell(value: Any) -> Any:
    """Return numbers and texts unchanged, anything else as JSON."""
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, dict | list | bool) or value is None:
        return msgspec.json.encode(value).decode()
    return value


_LONGEST = 200
"""Characters of a table's name; file systems take 255 bytes."""


def _paths(where: Path, keys: Collection[str]) -> dict[str, Path]:
    """Return a file for each key; no two share one, also where case makes no difference."""
    found: dict[str, Path] = {}
    taken = set[str]()
    for key in keys:
        # A dot stands for a slash, but the first one would hide the file.
        whole = quote(key, safe="/@ ").replace(".", "%2E")
        name = whole[:1].replace("/", "%2F") + whole[1:].replace("/", ".")
        short, number = name[:_LONGEST], 1
        while short.casefold() in taken:
            number += 1
            short = f"{name[:_LONGEST]}~{number}"
        taken.add(short.casefold())
        found[key] = where / f"{short}.csv"
    return found
