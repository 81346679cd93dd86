"""`param load`: sets on the running system what a file says."""

from pathlib import Path
from typing import Annotated, Any

from cli import output
from cli.declare import Arg
from cli.options import Options
from cli.param.changes import Change, changes, known_of, lines, values_of
from cli.param.running import Running, Values
from services.runtime.errors import Invalid, QuadctlError
from services.runtime.params.catalogue import fixed_at_launch, live_switch
from services.runtime.params.load import check, read, said_of
from services.runtime.params.names import flatten, put


def load(options: Options, file: Annotated[Path, Arg("A parameter file.")]) -> None:
    """Set all that a file says on the running system; what it does not name stays.

    Everything is checked before anything is changed. Then each node takes all of its values or
    none.

    Example: quadctl param load tuned.toml
    """
    said = _said(file, options)
    with Running(options) as running:
        now = running.whole()
        wanted = known_of(said, now)
        found = changes({name: now.get(name) for name in wanted}, wanted)
        _check(now | wanted, file)
        _refuse_fixed(found, file)
        _set(running, found)
    if options.json:
        output.document([change.document() for change in found])
    else:
        lines(found)


def _said(file: Path, options: Options) -> Values:
    """What the file itself names, each value as its type has it; raises Invalid."""
    tables = read(file)
    whole = values_of(tables, str(file), options)
    named = flatten(said_of(tables, options.vehicle, options.vehicles))
    return {name: whole[name] for name, _ in named if name in whole}


def _check(values: Values, file: Path) -> None:
    """Rules between values hold for the file's beside those that stay, too."""
    tables: dict[str, Any] = {}
    for name, value in values.items():
        put(tables, name, value, str(file))
    check(tables, f"{file} on the running system")


def _refuse_fixed(found: list[Change], file: Path) -> None:
    fixed = [change for change in found if fixed_at_launch(change.name)]
    if fixed:
        switches = "".join(
            f", and use {switch}" for change in fixed if (switch := live_switch(change.name))
        )
        raise Invalid(
            f"fixed at launch: {_told(fixed)}; nothing was changed",
            f"`quadctl down`, then `quadctl up {file}`; or take it out of the file{switches}",
        )


def _set(running: Running, found: list[Change]) -> None:
    nodes: dict[str, list[Change]] = {}
    for change in found:
        nodes.setdefault(change.name.partition(".")[0], []).append(change)
    live = running.nodes()
    for node in nodes:
        if node not in live:
            raise running.absent(node)
    for number, (node, mine) in enumerate(nodes.items()):
        try:
            reply = running.set(node, {change.name: change.after for change in mine})
            if not reply.success:
                raise Invalid(reply.reason)
        except QuadctlError as problem:
            told = _how_far([*nodes.values()], number)
            raise type(problem)(f"{problem.message}; {told}", problem.hint) from problem


def _how_far(parts: list[list[Change]], failed: int) -> str:
    """What was changed and what was not, when one of the parts, a node's each, has failed."""
    done = [change for part in parts[:failed] for change in part]
    rest = [change for part in parts[failed + 1 :] for change in part]
    told = {"changed": done, "failed": parts[failed], "not tried": rest}
    return "; ".join(f"{what}: {_told(some) or 'nothing'}" for what, some in told.items())


def _told(found: list[Change]) -> str:
    return ", ".join(map(str, found))
