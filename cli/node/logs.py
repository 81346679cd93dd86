"""`node logs`: what the processes of a realm have printed."""

import time
from contextlib import ExitStack
from typing import Annotated

from cli import output, which
from cli.declare import Arg, Opt
from cli.node.tail import Tail
from cli.options import Options, here
from services.runtime import run_files
from services.runtime.errors import Unreachable
from services.runtime.params.names import nearest, normal_name
from services.runtime.realm import Realm

_LOOK_EVERY = 0.1
_SUFFIX = ".log"


def logs(
    options: Options,
    name: Annotated[str | None, Arg("A node (default: all).", complete="node")] = None,
    count: Annotated[int | None, Opt("The last so many lines of each.", ("-n",), min=0)] = None,
    follow: Annotated[
        bool, Opt("Go on, until Ctrl-C or the run's end.", ("--follow", "-f"))
    ] = False,
) -> None:
    """Print what nodes have printed; without a name that of all, one after the other.

    `up` is the supervisor itself.

    Example: quadctl node logs safety -n 20 -f
    """
    here(options, "node logs")
    if name is not None:
        options, name = which.about_node(options, name)
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
