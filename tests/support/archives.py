"""Hand-ins as students pack them, damaged ones and hostile ones: each written to a folder, and its path returned."""

import io
import stat
import tarfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

LAB = {
    "quad.toml": b'[processes]\nsafety = "python my_safety.py"\n',
    "my_safety.py": b"print('safe')\n" * 40,
}
"""Smallest hand-in."""


def folder(path: Path, files: Mapping[str, bytes] = LAB) -> Path:
    for name, data in files.items():
        file = path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
    path.mkdir(exist_ok=True)
    return path


def zipped(files: Mapping[str, bytes] = LAB, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, data in files.items():
            # A name is written as it is, with backslashes too.
            info = zipfile.ZipInfo("x")
            info.filename, info.compress_type = name, method
            archive.writestr(info, data)
    return out.getvalue()


def zipped_link(name: str, target: str, mode: int = stat.S_IFLNK) -> bytes:
    """Return a zip file of the hand-in and an entry of another kind."""
    out = io.BytesIO(zipped())
    with zipfile.ZipFile(out, "a") as archive:
        info = zipfile.ZipInfo(name)
        info.create_system, info.external_attr = 3, (mode | 0o755) << 16
        archive.writestr(info, target)
    return out.getvalue()


def tarred(
    files: Mapping[str, bytes] = LAB, mode: str = "w", others: Iterable[tarfile.TarInfo] = ()
) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode=mode) as archive:  # type: ignore[call-overload]
        for name, data in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
        for info in others:
            archive.addfile(info)
    return out.getvalue()


def special(kind: bytes, name: str = "other", target: str = "") -> tarfile.TarInfo:
    """Return an entry of a tar file that is no file, e.g. a link."""
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, target
    return info


def below(top: str, files: Mapping[str, bytes] = LAB) -> dict[str, bytes]:
    """Return files with the names that they have in a folder."""
    return {f"{top}/{name}": data for name, data in files.items()}


def flipped(data: bytes, at: int, bit: int = 0) -> bytes:
    """Return data with a bit flipped."""
    return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]


def replaced(data: bytes, old: bytes, new: bytes) -> bytes:
    """Return data with other bytes in place of some that are there."""
    assert old in data
    return data.replace(old, new)
