"""New files: existing ones are never overwritten."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from quadctl.services.runtime.errors import Invalid

_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}


def write_new(path: Path, text: str) -> None:
    """Write a text to a new file, whole or not at all; raise Invalid if it cannot be written."""
    with making(path), path.open("x", encoding="utf-8") as out:
        try:
            out.write(text)
            out.flush()
        except OSError:
            path.unlink(missing_ok=True)
            raise


@contextmanager
def making(path: Path) -> Iterator[None]:
    """Raise Invalid with the reason if the block cannot create its file."""
    try:
        yield
    except FileExistsError as error:
        raise already_exists(path) from error
    except OSError as error:
        full = error.errno in _FULL
        hint = "make room on its disk" if full else "choose a folder that you may write to"
        raise Invalid(f"{path} cannot be written: {error.strerror}", hint) from error


def already_exists(path: Path, *, force: bool = False) -> Invalid:
    """Return the error for a file that already exists, which a command may have `--force` for."""
    hint = "choose another name, or remove the file"
    return Invalid(f"{path} already exists", f"{hint}; --force overwrites it" if force else hint)
