"""`node logs`, with `--follow`."""

import os
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, BinaryIO, Self

from quadctl.cli import context, output
from quadctl.cli.context import Options, require_local
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Unreachable
from quadctl.services.runtime.params.names import nearest, normal_name
from quadctl.services.runtime.realm import Realm


class Tail:
    """Reader of the lines of NAME.log, after those of the older NAME.log.1."""

    def __init__(self, path: Path) -> None:
        """Open nothing yet: the file may appear later."""
        self._path = path
        self._file: BinaryIO | None = None
        self._part = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def all(self) -> list[str]:
        """Return all lines, the older file's first."""
        lines = self.more()
        return [*self._old(), *lines]

    def more(self) -> list[str]:
        """Return the complete lines since the previous call; at first, all lines."""
        found = b""
        if self._file is not None:
            found = self._rest(self._file)
            if self._is_file(self._file):
                return self._whole(found)
            # The file was full and has another name now. Read also the lines added since.
            found += self._rest(self._file)
            self._file.close()
            self._file = None
        try:
            self._file = self._path.open("rb")
        except FileNotFoundError:
            return self._whole(found)
        return self._whole(found + self._rest(self._file))

    def _old(self) -> list[str]:
        try:
            with self._path.with_name(f"{self._path.name}.1").open("rb") as old:
                # The file just read may have been renamed to this one.
                return [] if self._file and _same(old, self._file) else _lines(old.read())
        except FileNotFoundError:
            return []

    def _rest(self, file: BinaryIO) -> bytes:
        if os.fstat(file.fileno()).st_size < file.tell():
            # The file has been emptied.
            file.seek(0)
            self._part = b""
        return file.read()

    def _is_file(self, file: BinaryIO) -> bool:
        try:
            with self._path.open("rb") as now:
                return _same(now, file)
        except FileNotFoundError:
            return True

    def _whole(self, fresh: bytes) -> list[str]:
        done, newline, self._part = (self._part + fresh).rpartition(b"\n")
        return _lines(done + newline)


def _lines(text: bytes) -> list[str]:
    return [line.decode(errors="replace") for line in text.split(b"\n")[:-1]]


def _same(one: BinaryIO, other: BinaryIO) -> bool:
    return os.path.sameopenfile(one.fileno(), other.fileno())


_LOOK_EVERY = 0.1
_SUFFIX = ".log"


def logs(
    options: Options,
    name: Annotated[str | None, Arg("A node (default: all).", complete="node")] = None,
    count: Annotated[int | None, Option("Number of last lines of each.", ("-n",), min=0)] = None,
    follow: Annotated[
        bool, Option("Follow, until Ctrl-C or the run's end.", ("--follow", "-f"))
    ] = False,
) -> None:
    """Print the log of a node, or of all nodes, one after the other; `up` is the supervisor.

    Example: quadctl node logs safety -n 20 -f
    """
    require_local(options, "node logs")
    if name is not None:
        options, name = context.about_node(options, name)
    realm = Realm(options.realm)
    if not run_files.is_live(realm) and not realm.logs.is_dir():
        raise run_files.not_running(realm)
    wanted = "" if name is None else _known(realm, name)
    with ExitStack() as opened:
        tails = {
            node: opened.enter_context(_tail(realm, node))
            for node in ([wanted] if wanted else _printing(realm))
        }
        for node, tail in tails.items():
            lines = tail.all()
            first = 0 if count is None else max(len(lines) - count, 0)
            _show(options, node, lines[first:], wanted)
        while follow:
            # Checked before reading, so that the last lines of the run are shown.
            follow = run_files.is_live(realm)
            for node in [] if wanted else _printing(realm):
                if node not in tails:
                    tails[node] = opened.enter_context(_tail(realm, node))
            for node, tail in tails.items():
                _show(options, node, tail.more(), wanted)
            time.sleep(_LOOK_EVERY if follow else 0)


def _tail(realm: Realm, node: str) -> Tail:
    return Tail(realm.logs / f"{node}{_SUFFIX}")


def _known(realm: Realm, name: str) -> str:
    """Return the name of a process of the run, live or killed; raise Unreachable."""
    wanted, names = normal_name(name), set(_printing(realm))
    if run_files.is_live(realm):
        names |= {"up", *(process.name for process in run_files.read(realm).nodes)}
    if wanted not in names:
        hint = nearest(wanted, names) or f"there are {', '.join(sorted(names))}"
        raise Unreachable(f"no process {name} in the realm {realm.name}", hint)
    return wanted


def _printing(realm: Realm) -> list[str]:
    """Return the processes that have a log; the logs of a killed run remain."""
    return sorted(path.stem for path in realm.logs.glob(f"*{_SUFFIX}"))


def _show(options: Options, node: str, lines: list[str], wanted: str) -> None:
    for line in lines:
        document = {"node": node, "line": line}
        output.either(options, document, line if wanted else f"{node:8} | {line}")
