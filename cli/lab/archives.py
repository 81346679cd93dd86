"""Entries of a folder, a zip or a tar file, without what no hand-in needs. Nothing is written or trusted here."""

import bz2
import errno
import gzip
import lzma
import os
import stat
import struct
import tarfile
import time
import zipfile
import zlib
from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from io import BufferedReader, RawIOBase
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

from quadctl.services.runtime.errors import Invalid

_ENDINGS = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.xz", ".txz", ".tar.bz2")
"""Ends of the names of archives."""
_IGNORED = frozenset({
    "__MACOSX", ".DS_Store", "Thumbs.db", "desktop.ini", "__pycache__", ".pytest_cache", ".mypy_cache",
    ".ruff_cache", ".hypothesis", ".venv", "site-packages", "node_modules", ".git", ".idea", ".vscode",
})  # fmt: skip
_ENVIRONMENT, LAB = "pyvenv.cfg", "quad.toml"
"""File of each folder that is an environment of Python, unless it is also a lab's."""
_MOST_ENTRIES, _MOST_READ, _MOST_SECONDS = 100_000, 1 << 30, 60.0
"""Entries of an archive, and bytes and time of a tar file, with those that are ignored."""
_MOST_DIRECTORY, _MOST_HEADER, _MOST_MEMORY = 16 << 20, 16 << 10, 128 << 20
"""Bytes of the directory of a zip file, of a tar header's extension, and of a decoder's memory."""
_METHODS = {9: "Deflate64", 12: "bzip2", 14: "LZMA", 93: "Zstandard", 95: "XZ", 98: "PPMd"}
_AGAIN = "make the archive again, open it once, and hand it in anew"
_LESS = "leave out recordings and environments"
_SEE = "see the rights of its files and the room on this disk, and grade it again"
_DAMAGES = (
    zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, struct.error, EOFError,
    ValueError, OverflowError, NotImplementedError, RecursionError,
)  # fmt: skip
"""Errors of the standard library's readers that a damaged file causes."""


class ArchiveEntry(NamedTuple):
    """Entry of a folder or an archive by its name, with `/` between folders.

    `kind` is file, folder, link, or the words for what no hand-in may have. `open` opens a file, or a link without a
    `target`, whose content it is. `runs`: a file is a program.
    """

    name: str
    kind: str
    open: Callable[[], IO[bytes]]
    target: str | None = None
    runs: bool = False


def is_archive(name: str) -> bool:
    """Return whether a file is an archive, by its name."""
    return stem(name) != name


def stem(name: str) -> str:
    """Return a name without the ending of an archive."""
    return next((name[: -len(end)] for end in _ENDINGS if name.lower().endswith(end)), name)


def entries(path: Path) -> Generator[ArchiveEntry]:
    """Yield the entries of a folder or an archive; a file of Python is its own and only one.

    Read each before the next, and all of it in `reporting`. Raises Invalid for a file that is none of these.
    """
    yield from _reader(path)(path)


def _reader(path: Path) -> Callable[[Path], Iterator[ArchiveEntry]]:
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        return _of_folder
    if not stat.S_ISREG(mode):
        raise Invalid("it is neither a folder nor a file", "hand in one of these")
    with path.open("rb") as opened:
        head = opened.read(tarfile.BLOCKSIZE)
    if not head:
        raise Invalid("it is empty", "hand it in anew")
    if path.suffix.lower() == ".py":
        return _of_file
    if head.startswith(tuple(_DECODERS)) or head[257:262] == b"ustar":
        return _of_tar
    if head.startswith(b"PK") or zipfile.is_zipfile(path):
        return _of_zip
    raise Invalid(
        "it is neither a folder, a zip or tar file, nor a .py file", "hand in one of these"
    )


@contextmanager
def reporting() -> Iterator[None]:
    """Raise Invalid if the block finds a damaged file, or one that it cannot read or copy."""
    try:
        yield
    except _DAMAGES as error:
        raise _damaged(error) from error
    except FileNotFoundError as error:
        name = Path(os.fsdecode(error.filename)).name
        raise Invalid(
            f"it changed while it was copied: {name} has gone", "grade it again"
        ) from error
    except OSError as error:
        # Decoders raise it without a number; a damaged zip file may name a place before its beginning.
        if error.errno in {None, errno.EINVAL}:
            raise _damaged(error) from error
        name = f"{Path(os.fsdecode(error.filename)).name}: " if error.filename else ""
        raise Invalid(f"it cannot be copied: {name}{error.strerror}", _SEE) from error


def _damaged(error: Exception) -> Invalid:
    return Invalid(f"it is damaged: {str(error) or 'it ends too early'}", _AGAIN)


def _is_ignored(name: str) -> bool:
    return any(
        part in _IGNORED or part.startswith("._") or part.endswith(".mcap")
        for part in name.split("/")
    )


def _without_environments(names: Collection[str]) -> Callable[[str], bool]:
    """Return a test of names for what belongs to a hand-in, given all names of an archive."""
    found = (name.removesuffix(_ENVIRONMENT) for name in names if name.endswith(f"/{_ENVIRONMENT}"))
    homes = tuple(home for home in found if f"{home}{LAB}" not in names)
    return lambda name: bool(name) and not _is_ignored(name) and not f"{name}/".startswith(homes)


def _plain(name: str) -> str:
    """Return a name as this system writes it: PowerShell writes backslashes, and some tools byte order marks."""
    name = name.replace("\\", "/").replace("\ufeff", "")
    root = "/" if name.startswith("/") else ""
    return root + "/".join(part for part in name.split("/") if part not in {"", "."})


def _of_file(path: Path) -> Iterator[ArchiveEntry]:
    yield ArchiveEntry(_plain(path.name), "file", lambda: path.open("rb"))


def _of_folder(root: Path) -> Iterator[ArchiveEntry]:
    waiting = [root]
    while waiting:
        folder = waiting.pop()
        name = folder.relative_to(root).as_posix()
        try:
            found = sorted(os.listdir(folder))  # noqa: PTH208 - names, without a path for each
            if _ENVIRONMENT in found and LAB not in found and folder != root:
                continue
            inside = [entry for each in found if (entry := _in_folder(root, folder / each))]
        except OSError as error:
            if folder == root:
                raise
            yield ArchiveEntry(name, f"a folder that cannot be read: {error.strerror}", _nothing)
            continue
        if folder != root:
            yield ArchiveEntry(name, "folder", _nothing)
        waiting += [root / each.name for each in inside if each.kind == "folder"]
        yield from (each for each in inside if each.kind != "folder")


def _in_folder(root: Path, path: Path) -> ArchiveEntry | None:
    name = path.relative_to(root).as_posix()
    if _is_ignored(name):
        return None
    mode = path.lstat().st_mode
    target = _within(root, path) if stat.S_ISLNK(mode) else None
    return ArchiveEntry(name, _kind(mode), partial(_open, path), target, bool(mode & stat.S_IXUSR))


def _within(root: Path, link: Path) -> str:
    """Return the target of a link, relative if it is absolute and within the root: a copy is elsewhere."""
    target = str(link.readlink())
    real, top = (os.path.realpath(each) for each in (link, root))
    if os.path.isabs(target) and Path(real).is_relative_to(top):  # noqa: PTH117
        return os.path.relpath(real, os.path.realpath(link.parent))
    return target


def _open(path: Path) -> IO[bytes]:
    """Open a file of a folder, even if it has become a link or a pipe since the folder was listed."""
    flags = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
    opened = os.fdopen(os.open(path, os.O_RDONLY | flags), "rb")
    if not stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
        opened.close()
        raise Invalid(f"it changed while it was copied: {path.name}", "grade it again")
    return opened


def _nothing() -> IO[bytes]:
    raise NotImplementedError("it has no content")


def _kind(mode: int) -> str:
    """Return the kind of an entry by its mode."""
    kinds = {
        stat.S_IFREG: "file", stat.S_IFDIR: "folder", stat.S_IFLNK: "link", stat.S_IFIFO: "a pipe",
        stat.S_IFSOCK: "a socket",
    }  # fmt: skip
    return kinds.get(stat.S_IFMT(mode), "a device")


def _require_few(count: int) -> None:
    if count > _MOST_ENTRIES:
        raise Invalid(f"it has more than {_MOST_ENTRIES} entries", _LESS)


class _Bounded(BufferedReader):
    """Zip file whose directory, which is read at once, has a limit."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is None or not size <= _MOST_DIRECTORY:
            raise zipfile.BadZipFile("its directory is too large")
        return super().read(size)


def _of_zip(file: Path) -> Iterator[ArchiveEntry]:
    with _Bounded(file.open("rb", buffering=0)) as opened, zipfile.ZipFile(opened) as archive:
        found = [(_plain(_zip_name(info)), info) for info in archive.infolist()]
        _require_few(len(found))
        belongs = _without_environments({name for name, _ in found})
        for name, info in found:
            if belongs(name):
                yield _in_zip(archive, info, name)


def _in_zip(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> ArchiveEntry:
    mode = info.external_attr >> 16
    is_folder = _zip_name(info).endswith(("/", "\\"))
    kind = _kind(mode) if stat.S_IFMT(mode) else "folder" if is_folder else "file"
    return ArchiveEntry(
        name, kind, partial(_open_zipped, archive, info), runs=bool(mode & stat.S_IXUSR)
    )


def _zip_name(info: zipfile.ZipInfo) -> str:
    """Return the name in a zip file: zipfile takes cp437 for all that is not marked as UTF-8, as macOS leaves it."""
    name = info.orig_filename
    if not info.flag_bits & 0x800:
        with suppress(UnicodeError):
            return name.encode("cp437").decode("utf-8")
    return name


def _open_zipped(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> IO[bytes]:
    if info.flag_bits & 0x1:
        raise Invalid("it is locked by a password", "hand in an archive without one")
    if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        method = _METHODS.get(info.compress_type, f"method {info.compress_type}")
        raise Invalid(f"it is compressed by {method}", "compress it by Deflate, the usual method")
    return archive.open(info)


class _Decoded(RawIOBase):
    """Content of an xz file, by a decoder whose memory has a limit."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._decoder = file, lzma.LZMADecompressor(memlimit=_MOST_MEMORY)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any, /) -> int:
        while not self._decoder.eof:
            data = self._file.read(1 << 16) if self._decoder.needs_input else b""
            if self._decoder.needs_input and not data:
                raise EOFError
            if made := self._decoder.decompress(data, len(buffer)):
                buffer[: len(made)] = made
                return len(made)
        return 0


_DECODERS: dict[bytes, Callable[[Any], Any]] = {
    b"\x1f\x8b": lambda file: gzip.GzipFile(fileobj=file),
    b"BZh": bz2.BZ2File,
    b"\xfd7zXZ\0": lambda file: BufferedReader(_Decoded(file)),
}
"""Decoder of a compressed tar file, by the first bytes of the file."""


class _Limited:
    """Stream that ends with an error after the bytes and the time that an archive may take.

    There are headers of a few kB for which tarfile's regular expressions take a second.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._left = file, _MOST_READ
        self._until = time.monotonic() + _MOST_SECONDS

    def read(self, size: int) -> bytes:
        data = self._file.read(size)
        self._left -= len(data)
        if self._left < 0 or time.monotonic() > self._until:
            most = f"{_MOST_READ >> 20} MB or {_MOST_SECONDS:g} s"
            raise Invalid(f"it takes more than {most} to unpack", _LESS)
        return data


_EXTENSIONS = {
    tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE, tarfile.GNUTYPE_LONGNAME,
    tarfile.GNUTYPE_LONGLINK,
}  # fmt: skip
"""Types of headers that are followed by a part of the next header."""


class _Header(tarfile.TarInfo):
    """Header that must be whole: tarfile takes a broken one for the end, and reads extensions of any size."""

    @classmethod
    def fromtarfile(cls, archive: tarfile.TarFile) -> Self:
        try:
            return super().fromtarfile(archive)
        except tarfile.EOFHeaderError:  # type: ignore[attr-defined]
            raise  # a block of zeros: this is the end
        except tarfile.HeaderError as error:
            raise tarfile.ReadError(str(error)) from error

    def _proc_member(self, archive: tarfile.TarFile) -> tarfile.TarInfo:
        # tarfile calls it with each header before it reads what belongs to it, for subclasses to change.
        if self.size > _MOST_HEADER and self.type in _EXTENSIONS:
            raise tarfile.ReadError("a header is too large")
        return super()._proc_member(archive)  # type: ignore[misc, no-any-return]


def _of_tar(file: Path) -> Iterator[ArchiveEntry]:
    # An environment's mark may come after its files.
    belongs = _without_environments({_plain(member.name) for _, member in _members(file)})
    for archive, member in _members(file):
        name = _plain(member.name)
        if belongs(name):
            opening = partial(_extracted, archive, member)
            yield ArchiveEntry(
                name, _tar_kind(member), opening, member.linkname, bool(member.mode & 0o100)
            )


def _members(file: Path) -> Iterator[tuple[tarfile.TarFile, tarfile.TarInfo]]:
    with file.open("rb") as opened:
        head = opened.read(8)
        opened.seek(0)
        decoders = [made for magic, made in _DECODERS.items() if head.startswith(magic)]
        stream = _Limited(decoders[0](opened) if decoders else opened)
        with tarfile.open(fileobj=stream, mode="r|", tarinfo=_Header) as archive:  # type: ignore[call-overload]
            for count, member in enumerate(archive):
                _require_few(count)
                yield archive, member
        while stream.read(1 << 16):
            pass  # a checksum is at the end


def _extracted(archive: tarfile.TarFile, member: tarfile.TarInfo) -> IO[bytes]:
    opened = archive.extractfile(member)
    if opened is None:
        raise tarfile.ReadError(f"{member.name} has no content")
    return opened


def _tar_kind(member: tarfile.TarInfo) -> str:
    tests = {
        "file": member.isreg, "folder": member.isdir, "link": member.issym, "a hard link": member.islnk,
        "a pipe": member.isfifo,
    }  # fmt: skip
    return next((kind for kind, holds in tests.items() if holds()), "a device")
