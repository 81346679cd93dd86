"""`node logs`, with `--follow`."""

import os
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, BinaryIO, Self

from quadctl.cli import context, output
from quadctl.cli.context import Options, here
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Unreachable
from quadctl.services.runtime.params.names import nearest, normal_name
from quadctl.services.runtime.realm import Realm


class Tail:
    """The lines of NAME.log, those of the older NAME.log.1 before them."""

    def __init__(self, path: Path) -> None:
        """Opens nothing yet; the file may come later."""
        self._path = path
        self._file: BinaryIO | None = None
        self._part = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def all(self) -> list[str]:
        """All lines that there are, from the file that was full before on."""
        lines = self.more()
        return [*self._old(), *lines]

    def more(self) -> list[str]:
        """The whole lines that have come since the last call, at first all."""
        found = b""
        if self._file is not None:
            found = self._rest(self._file)
            if self._is_file(self._file):
                return self._whole(found)
            # It was full and has another name now. What came while we looked is in it, too.
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
                # The one just read may have got that name meanwhile.
                return [] if self._file and _same(old, self._file) else _lines(old.read())
        except FileNotFoundError:
            return []

    def _rest(self, file: BinaryIO) -> bytes:
        if os.fstat(file.fileno()).st_size < file.tell():
            # Somebody has emptied it.
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
    count: Annotated[int | None, Option("The last so many lines of each.", ("-n",), min=0)] = None,
    follow: Annotated[
        bool, Option("Go on, until Ctrl-C or the run's end.", ("--follow", "-f"))
    ] = False,
) -> None:
    """Print what nodes have printed; without a name that of all, one after the other.

    `up` is the supervisor itself.

    Example: quadctl node logs safety -n 20 -f
    """
    here(options, "node logs")
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
            # Asked before the look, so that what is said until the end is shown.
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
    """A process of the run, or of a killed one's; raises Unreachable with the nearest name."""
    wanted, names = normal_name(name), set(_printing(realm))
    if run_files.is_live(realm):
        names |= {process.name for process in run_files.read(realm).nodes}
    if wanted not in names:
        hint = nearest(wanted, names) or f"there are {', '.join(sorted(names))}"
        raise Unreachable(f"no process {name} in the realm {realm.name}", hint)
    return wanted


def _printing(realm: Realm) -> list[str]:
    """Who has printed something; of a run that was killed the files are still there."""
    return sorted(path.stem for path in realm.logs.glob(f"*{_SUFFIX}"))


def _show(options: Options, node: str, lines: list[str], wanted: str) -> None:
    for line in lines:
        said = {"node": node, "line": line}
        output.either(options, said, line if wanted else f"{node:8} | {line}")
