"""Edits of a parameter file in place, with comments, order and format kept."""

import contextlib
import os
from pathlib import Path
from typing import Any

from quadctl.services.runtime.errors import Invalid


def edited(text: str, values: dict[str, Any]) -> str:
    """Return a file's text with values set by dotted name; a missing table is added at the end."""
    import tomlkit
    from tomlkit.items import InlineTable

    document = tomlkit.parse(text)
    for name, value in values.items():
        *path, last = name.split(".")
        table: Any = document
        for depth, part in enumerate(path):
            if part not in table:
                # A table within an inline one can only be inline.
                fresh = tomlkit.table(is_super_table=depth < len(path) - 1)
                table[part] = tomlkit.inline_table() if isinstance(table, InlineTable) else fresh
            table = table[part]
        table[last] = value
    return tomlkit.dumps(document)


def replace(file: Path, data: bytes) -> None:
    """Replace a file so that a crash leaves the old text or the new; raise Invalid.

    A link stays a link, and the file keeps its mode and owner.
    """
    try:
        target = file.resolve()
        fresh = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            with fresh.open("xb") as out:
                _like(target, out.fileno())
                out.write(data)
                out.flush()
                os.fsync(out.fileno())
            fresh.replace(target)
        except OSError:
            fresh.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise Invalid(
            f"{file} cannot be written: {error.strerror}", "name a place that you may write to"
        ) from error


def _like(target: Path, descriptor: int) -> None:
    with contextlib.suppress(FileNotFoundError):
        was = target.stat()
        if os.name == "posix":
            # Only root may give a file away; for any other user it becomes their own.
            with contextlib.suppress(PermissionError):
                os.fchown(descriptor, was.st_uid, was.st_gid)
            os.fchmod(descriptor, was.st_mode & 0o7777)
