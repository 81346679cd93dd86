"""Files that people write and read: texts of any editor, and new files, which overwrite none."""

import codecs
import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import IO, NamedTuple

from quadctl.services.runtime.errors import Invalid

_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
_REMEDIES = dict.fromkeys(_FULL, "make room on its disk") | {
    errno.ENOENT: "make its folder first",
    errno.EISDIR: "name a file",
    errno.ENAMETOOLONG: "give it a shorter name",
}
_UNREADABLE = {
    errno.EACCES: "give it to your user, or name another file",
    errno.EISDIR: "name a file in it",
}

_MOST_BYTES = 1_000_000
"""Bytes of the largest text that is read; parameters of a thousand vehicles have a tenth of this."""
_MARKS = (  # UTF-32 comes first, as its mark begins with that of UTF-16
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


class Text(NamedTuple):
    """Text of a file with its line ends unchanged, its encoding and its byte order mark, if any."""

    text: str
    encoding: str
    mark: bytes

    def encoded(self, text: str) -> bytes:
        """Return a new text of the same file as bytes: with its encoding, mark and line ends."""
        if "\r\n" in self.text and "\n" not in self.text.replace("\r\n", ""):
            text = text.replace("\r\n", "\n").replace("\n", "\r\n")
        return self.mark + text.encode(self.encoding)


def opened(path: Path) -> IO[bytes]:
    """Open a file for reading; raise OSError if it cannot be, or is a pipe without a writer.

    An ordinary open would wait for a writer, perhaps for ever.
    """
    found = open(path, "rb", opener=_at_once)  # noqa: SIM115 - Path.open has no opener
    if stat.S_ISFIFO(os.fstat(found.fileno()).st_mode) and not found.peek(1):
        found.close()
        raise OSError(errno.EPIPE, "it is a pipe to which nothing writes")
    return found


def _at_once(path: str, flags: int) -> int:
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(descriptor, True)
    return descriptor


def read_text(file: Path, hint: str) -> Text:
    """Read a text of any editor, UTF-8, UTF-16 or UTF-32; raise Invalid if it cannot be read."""
    try:
        with opened(file) as found:
            # Pipes are allowed, but a device such as /dev/zero never ends.
            data = found.read(_MOST_BYTES + 1)
    except OSError as error:
        raise unreadable(file, error, hint) from error
    if len(data) > _MOST_BYTES:
        raise Invalid(f"{file} is too large: it has more than 1 MB", hint)
    mark, encoding = _encoding(data)
    try:
        return Text(data[len(mark) :].decode(encoding), encoding, mark)
    except UnicodeDecodeError as error:
        problem = f"{file} is not a text: {error}"
        raise Invalid(problem, "save it as UTF-8 in your editor") from error


def _encoding(data: bytes) -> tuple[bytes, str]:
    """Return the byte order mark and the encoding of a text that begins with an ASCII character."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return mark, encoding
    if len(data) > 1 and (data[0] == 0) != (data[1] == 0):
        return b"", "utf-16-be" if data[0] == 0 else "utf-16-le"
    return b"", "utf-8"


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that a crash leaves the old content or the new; raise Invalid if it cannot be.

    A link stays a link, a file keeps its mode and owner, and a pipe or a device is written to.
    """
    with making(path):
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        target = path.resolve()
        if target.exists():
            if target.stat().st_nlink > 1:
                raise Invalid(
                    f"{path} has another name as well, a hard link, which would keep the old content",
                    "copy it, and write the copy",
                )
            if not os.access(target, os.W_OK):  # a folder that may be written to would permit it
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        fresh = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            with fresh.open("xb") as out:
                _like(target, out.fileno())
                out.write(data)
                out.flush()
                os.fsync(out.fileno())
            fresh.replace(target)
        except BaseException:  # also a Ctrl-C
            fresh.unlink(missing_ok=True)
            raise


def _like(target: Path, descriptor: int) -> None:
    with suppress(FileNotFoundError):
        was = target.stat()
        if os.name == "posix":
            # Only root may give a file away; for any other user it becomes their own.
            with suppress(PermissionError):
                os.fchown(descriptor, was.st_uid, was.st_gid)
            os.fchmod(descriptor, was.st_mode & 0o7777)


def refuse_existing(path: Path, *, force: bool) -> None:
    """Raise Invalid if a command would overwrite a file without its `--force`."""
    try:
        is_there, is_file = path.is_file() or path.is_dir(), path.is_file()
    except OSError as error:  # e.g. its name is too long
        raise unwritable(path, error) from error
    if is_there and not force:
        raise already_exists(path, force=is_file)


def free_name(stem: str, suffix: str) -> Path:
    """Return the first name in the current folder that is free: `stem.suffix`, `stem_1.suffix` .."""
    names = (Path(f"{stem}_{number}{suffix}" if number else stem + suffix) for number in count())
    return next(name for name in names if not name.exists())


def write_new(path: Path, text: str) -> None:
    """Write a text to a new file, whole or not at all; raise Invalid if it cannot be written."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        write_whole(path, text.encode())  # a pipe, e.g. /dev/stdout
        return
    with making(path), path.open("x", encoding="utf-8") as out:
        try:
            out.write(text)
            out.flush()
        except BaseException:
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
        raise unwritable(path, error) from error


def unreadable(path: Path, error: OSError, hint: str) -> Invalid:
    """Return the error for a file that cannot be read; `hint` is the remedy if there is none."""
    hint = _UNREADABLE.get(error.errno or 0, hint)
    return Invalid(f"{path} cannot be read: {error.strerror}", hint)


def unwritable(path: Path, error: OSError) -> Invalid:
    """Return the error for a file that the machine does not let us write, with a remedy."""
    hint = _REMEDIES.get(error.errno or 0, "choose a folder and a file that you may write to")
    if error.errno == errno.ENOENT and _is_here_deleted():
        hint = "`cd` to another folder: this one was deleted"
    return Invalid(f"{path} cannot be written: {error.strerror}", hint)


def _is_here_deleted() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def already_exists(path: Path, *, force: bool = False) -> Invalid:
    """Return the error for a file that already exists, which a command may have `--force` for."""
    hint = "choose another name, or remove the file"
    return Invalid(f"{path} already exists", f"{hint}; --force overwrites it" if force else hint)
