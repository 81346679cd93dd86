"""`param list|get`: reads the parameters of the running system."""

from typing import Annotated

from cli import output, which
from cli.declare import Arg
from cli.options import Options
from cli.param.running import ALL, Running
from cli.together import Heard
from services.runtime.params import catalogue
from services.runtime.params.names import normal_name


def list_(
    options: Options,
    tables: Annotated[
        list[str] | None, Arg("Nodes or tables (default: all).", complete="param")
    ] = None,
) -> None:
    """List every parameter of the running system, or those of a node.

    Of all, where a node does not answer, the others' are listed and the exit code tells.

    Example: quadctl param list safety
    """
    options, tables = which.about_parameters(options, tables or ["/"])
    with Running(options) as running:
        everything = ALL in map(normal_name, tables)
        heard = running.every() if everything else Heard({"": running.get(tables)}, {})
    names = sorted(name for answer in heard.answers.values() for name in answer)
    if options.json:
        output.document(names)
    else:
        for name in names:
            output.line(name)
    heard.fail()


def get(
    options: Options,
    names: Annotated[list[str], Arg("Parameters, whole tables, or / for all.", complete="param")],
) -> None:
    """Print the values of parameters, in the words that `param set` takes.

    Of a value that waits for the vehicle's next standstill, tell too what is in force until then.

    Example: quadctl param get safety.virtual_cage.x
    """
    options, names = which.about_parameters(options, names)
    with Running(options) as running:
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
