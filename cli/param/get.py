"""`param list`, `get` and `describe`."""

from typing import Annotated, Any

from msgspec import structs

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.parameters import ALL, leaves_of
from quadctl.schemas.params import FROM_STANDSTILL
from quadctl.schemas.typeinfo import bounds_text, type_name
from quadctl.services.runtime.concurrent import Answers
from quadctl.services.runtime.errors import QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.catalogue import Entry, fixed_at_launch
from quadctl.services.runtime.params.names import normal_name
from quadctl.services.runtime.params.remote import Values
from quadctl.services.runtime.run_files import UNSERVED


def describe(
    options: Options,
    names: Annotated[list[str], Arg("Parameters, or whole tables.", complete="param")],
) -> None:
    """Describe parameters: type, unit, bounds, default, meaning, and the present value.

    The present value is missing if nothing runs, or if a node does not answer: see the exit code.

    Example: quadctl param describe safety.virtual_cage
    """
    options, names = context.about_parameters(options, names)
    names = [normal_name(name) for name in _joined(names)]
    known = catalogue.leaves()
    found = {name: [known[leaf] for leaf in leaves_of(known, name)] for name in names}
    tables = {leaf.name.partition(".")[0] for leaves in found.values() for leaf in leaves}
    results = _present(options, tables)
    values = {name: value for answer in results.answers.values() for name, value in answer.items()}
    if options.json:
        output.document([_document(leaf, values) for leaves in found.values() for leaf in leaves])
    else:
        _print(found, values)
    results.fail()


def _joined(names: list[str]) -> list[str]:
    """Return `safety.takeoff` for a node and its parameter, as in ROS 2: `/safety takeoff`."""
    if len(names) != 2 or "." in names[0]:
        return names
    whole = normal_name(".".join(name.strip("/") for name in names))
    return [whole] if whole in catalogue.leaves() | catalogue.tables() else names


def _present(options: Options, tables: set[str]) -> Answers[Values]:
    try:
        with context.running_params(options) as running:
            return running.declared(sorted(tables))
    except Unreachable:
        if options.connect:
            raise
        return Answers({}, {})
    except TimedOut as problem:
        return Answers({}, {"hub": problem})


def _print(found: dict[str, list[Entry]], values: Values) -> None:
    tables = catalogue.tables()
    for number, (name, leaves) in enumerate(found.items()):
        if number:
            output.line("")
        rows = [_row(leaf, values) for leaf in leaves]
        if name in tables:
            output.line(f"{name}: {tables[name]}")
            head = [title.upper() for title in rows[0]]
            output.table([head, *([*row.values()] for row in rows)])
        else:
            output.table((f"{title.capitalize()}:", text) for title, text in rows[0].items())


def _row(leaf: Entry, values: Values) -> dict[str, str]:
    document = _document(leaf, values)
    return {
        "name": leaf.name,
        "type": document["type"],
        "unit": leaf.unit or "-",
        "bounds": document["bounds"] or "-",
        "default": catalogue.word(leaf.default),
        "value": "-" if document["value"] is None else catalogue.word(document["value"]),
        "node": document["node"] or "-",
        "change": _when(leaf.name),
        "meaning": leaf.about,
    }


def _when(name: str) -> str:
    if fixed_at_launch(name):
        return "at launch"
    return "at a standstill" if name.startswith(FROM_STANDSTILL) else "at once"


def _document(leaf: Entry, values: Values) -> dict[str, Any]:
    node = leaf.name.partition(".")[0]
    inside = {name: values[name] for name in values if name.startswith(f"{leaf.name}.")}
    return {
        "name": leaf.name,
        "type": type_name(leaf.type),
        "unit": leaf.unit,
        "bounds": bounds_text(leaf.type),
        "default": leaf.default,
        "value": values.get(leaf.name, inside or None),
        "node": "" if node in UNSERVED else node,
        "fixed_at_launch": fixed_at_launch(leaf.name),
        "meaning": leaf.about,
    }


def list_(
    options: Options,
    tables: Annotated[
        list[str] | None, Arg("Nodes or tables (default: all).", complete="param")
    ] = None,
) -> None:
    """List every parameter of the running system, or of some nodes.

    With several vehicles each name begins with its vehicle. If a node does not answer, only the
    rest is listed; see the exit code.

    Example: quadctl param list safety
    """
    options, tables = context.about_parameters(options, tables or ["/"])
    everything = ALL in map(normal_name, tables)
    vehicles = context.listed_vehicles(options)
    names: list[str] = []
    problems: dict[str, QuadctlError] = {}
    for vehicle in vehicles:
        whose = f"{vehicle}." if len(vehicles) > 1 else ""
        with context.running_params(structs.replace(options, named=vehicle)) as running:
            results = running.every() if everything else Answers({"": running.get(tables)}, {})
        names += sorted(f"{whose}{name}" for answer in results.answers.values() for name in answer)
        problems |= {f"{whose}{node}": problem for node, problem in results.problems.items()}
    if not problems:
        context.check_vehicle(options, names)
    if options.json:
        output.document(names)
    else:
        for name in names:
            output.line(name)
    Answers({}, problems).fail()


def get(
    options: Options,
    names: Annotated[list[str], Arg("Parameters, whole tables, or / for all.", complete="param")],
) -> None:
    """Print the values of parameters in the form that `param set` takes.

    If a value waits for the vehicle's next standstill, print also the value in force until then.

    Example: quadctl param get safety.virtual_cage.x
    """
    options, names = context.about_parameters(options, names)
    names = _joined(names)
    with context.running_params(options) as running:
        found = running.get(names)
    for name, value in running.in_force.items():
        output.note(f"{name}: {catalogue.word(value)} is in force until the next standstill")
    if options.json:
        waits = {"in_force": running.in_force} if running.in_force else {}
        output.document(found | waits)
    elif list(found) == [normal_name(name) for name in names[:1]]:
        output.line(catalogue.word(*found.values()))
    else:
        for name, value in found.items():
            output.line(f"{name}: {catalogue.word(value)}")
