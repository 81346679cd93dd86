"""`param dump`, `load`, `diff` and `save`."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Struct

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.parameters import RunningParams, tables
from quadctl.services.runtime.errors import Invalid, QuadctlError
from quadctl.services.runtime.files import read_text, write_new, write_whole
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.catalogue import fixed_at_launch, live_switch
from quadctl.services.runtime.params.load import (
    check,
    gather,
    of as params_of,
    parse,
    read,
    table_of,
)
from quadctl.services.runtime.params.names import flatten, put
from quadctl.services.runtime.params.remote import Values

DEFAULT_FILE = Path("quad.toml")
_WRITTEN_ANEW = "`quadctl param dump -o FILE` writes a new one"


class Change(Struct, frozen=True):
    """Parameter that differs between two sides; None on a side without it."""

    name: str
    before: Any
    after: Any

    def __str__(self) -> str:
        """Return e.g. `safety.takeoff: 1.0 -> 2.0`."""
        return f"{self.name}: {_shown(self.before)} -> {_shown(self.after)}"

    def document(self, before: str = "before", after: str = "after") -> dict[str, Any]:
        """Return the change as --json prints it, with the names of the two sides."""
        return {"name": self.name, before: self.before, after: self.after}


def changes(before: Values, after: Values) -> list[Change]:
    """Return the parameters that differ, in the order of declaration."""
    names = [*before, *(name for name in after if name not in before)]
    found = [Change(name, before.get(name), after.get(name)) for name in names]
    return [change for change in found if change.before != change.after]


def file_values(file: Path | None, options: Options) -> Values:
    """Return the vehicle's parameters as `up FILE` would set them; the defaults without a file."""
    return values_of(*gather(file), options)


def values_of(tables: Mapping[str, Any], source: str, options: Options) -> Values:
    """Return the vehicle's parameters by a file's tables; raise Invalid with the source."""
    params = params_of(tables, source, options.vehicles)[options.vehicle]
    whole = msgspec.to_builtins(params)
    return dict(flatten({name: table for name, table in whole.items() if table}))


def known_of(values: Values, running: Values) -> Values:
    """Return the values of the tables visible in the running system; note the others on stderr.

    With --connect the supervisor's own tables are not visible, nor those of a node that is down.
    """
    known = {name.partition(".")[0] for name in running}
    if "supervise" in known:
        known.add("processes")
    unseen = {name.partition(".")[0] for name in values} - known
    if unseen:
        left_out = ", ".join(name for name in tables() if name in unseen)
        output.note(f"left out, as it is not visible from here: {left_out}")
    return {name: value for name, value in values.items() if name.partition(".")[0] in known}


def print_changes(options: Options, document: Any, found: Iterable[Change]) -> None:
    """Print a document with --json, else one change per line."""
    if options.json:
        output.document(document)
    else:
        for change in found:
            output.line(str(change))


def _shown(value: Any) -> str:
    return "(none)" if value is None else catalogue.word(value)


def diff(
    options: Options,
    file: Annotated[
        Path | None, Arg("A parameter file (default: ./quad.toml, else the defaults in code).")
    ] = None,
) -> None:
    """Show the values that differ from a file: the file's and the running system's.

    Example: quadctl param diff quad.toml
    """
    source = file or (DEFAULT_FILE if DEFAULT_FILE.exists() else None)
    from_file = file_values(source, options)
    with context.running_params(options) as running:
        now = running.whole()
    context.check_vehicle(options, list(now))
    found = changes(known_of(from_file, now), now)
    print_changes(options, [change.document("file", "running") for change in found], found)


def dump(
    options: Options,
    names: Annotated[
        list[str] | None, Arg("Parameters, or whole tables (default: all).", complete="param")
    ] = None,
    file: Annotated[
        Path | None, Option("Write it there instead of to stdout.", ("--output", "-o"), "FILE")
    ] = None,
) -> None:
    """Print the running system's parameters as TOML, for `up FILE` or `param load FILE`.

    Example: quadctl param dump -o tuned.toml
    """
    if names:
        options, names = context.about_parameters(options, names)
    with context.running_params(options) as running:
        values = running.get(names) if names else running.whole()
    context.check_vehicle(options, list(values))
    if not names:
        known_of(file_values(None, options), values)
    text = catalogue.document(values)
    if file is not None:
        write_new(file, text)
        output.either(options, {"file": str(file)}, f"wrote {file}")
    elif options.json:
        output.document(values)
    else:
        output.line(text.rstrip("\n"))


def save(
    options: Options, file: Annotated[Path, Arg("The file to bring up to date.")] = DEFAULT_FILE
) -> None:
    """Write the running system's values into a parameter file; comments and order stay.

    Only values that differ from the file's (or the default, where the file has none) are written.
    With several vehicles they go into the vehicle's own table.

    Example: quadctl param save
    """
    from_file = file_values(file, options)
    with context.running_params(options) as running:
        now = running.whole()
    known = known_of(from_file, now)
    # A command that is in the file and not in the run was added since: it stays.
    found = [change for change in changes(known, now) if change.name in now]
    if found:
        own = f"{options.vehicle}." if len(options.vehicles) > 1 else ""
        was = read_text(file, _WRITTEN_ANEW)
        text = edited(was.text, {own + change.name: change.after for change in found})
        _verify(text, from_file | {change.name: change.after for change in found}, file, options)
        write_whole(file, was.encoded(text))
    changed = [change.document() for change in found]
    print_changes(options, {"file": str(file), "changed": changed}, found)


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


def _verify(text: str, wanted: Values, file: Path, options: Options) -> None:
    """Raise Invalid unless the new text has the wanted values; the file is still untouched."""
    if values_of(parse(text, str(file)), str(file), options) != wanted:
        raise Invalid(
            f"{file} cannot be changed in place, or has just been changed; it is untouched",
            _WRITTEN_ANEW,
        )


def load(options: Options, file: Annotated[Path, Arg("A parameter file.")]) -> None:
    """Set all values of a file on the running system; other parameters stay.

    All values are checked before any is changed. Then each node takes all of its values or none.

    Example: quadctl param load tuned.toml
    """
    from_file = _named_values(file, options)
    with context.running_params(options) as running:
        now = running.whole()
        wanted = known_of(from_file, now)
        found = changes({name: now.get(name) for name in wanted}, wanted)
        _check(now | wanted, file)
        _refuse_fixed(found, file)
        _set(running, found)
    print_changes(options, [change.document() for change in found], found)


def _named_values(file: Path, options: Options) -> Values:
    """Return the values that the file itself names, each in its type; raise Invalid."""
    tables = read(file)
    whole = values_of(tables, str(file), options)
    named = flatten(table_of(tables, options.vehicle, options.vehicles))
    return {name: whole[name] for name, _ in named if name in whole}


def _check(values: Values, file: Path) -> None:
    """Check the rules between values, the file's and those that stay; raise Invalid."""
    tables: dict[str, Any] = {}
    for name, value in values.items():
        put(tables, name, value, str(file))
    check(tables, f"{file} on the running system", in_wind=False)


def _refuse_fixed(found: list[Change], file: Path) -> None:
    fixed = [change for change in found if fixed_at_launch(change.name)]
    if fixed:
        switches = filter(None, (live_switch(change.name) for change in fixed))
        hint = f"`quadctl down`, then `quadctl up {file}`; or take it out of the file"
        hint += "".join(f", and use {switch}" for switch in switches)
        raise Invalid(f"fixed at launch: {_listed(fixed)}; nothing was changed", hint)


def _set(running: RunningParams, found: list[Change]) -> None:
    nodes: dict[str, list[Change]] = {}
    for change in found:
        nodes.setdefault(change.name.partition(".")[0], []).append(change)
    live = running.nodes()
    for node in nodes:
        if node not in live:
            raise running.absent(node)
    for number, (node, part) in enumerate(nodes.items()):
        try:
            reply = running.set(node, {change.name: change.after for change in part})
            if not reply.success:
                raise Invalid(reply.reason)
        except QuadctlError as problem:
            done = _outcome_text([*nodes.values()], number)
            raise type(problem)(f"{problem.message}; {done}", problem.hint) from problem


def _outcome_text(parts: list[list[Change]], failed: int) -> str:
    """Return the text that lists the changes by outcome, after one node's part has failed."""
    done = [change for part in parts[:failed] for change in part]
    rest = [change for part in parts[failed + 1 :] for change in part]
    outcomes = {"changed": done, "failed": parts[failed], "not tried": rest}
    return "; ".join(f"{name}: {_listed(part) or 'nothing'}" for name, part in outcomes.items())


def _listed(found: list[Change]) -> str:
    return ", ".join(map(str, found))
