"""`param list|get`: reads the parameters of the running system."""

from typing import Annotated

from cli import output, which
from cli.declare import Arg
from cli.options import Options
from cli.param.running import Running
from services.runtime.settings import toml
from services.runtime.settings.named import normal_name


def list_(options: Options) -> None:
    """List every parameter of the running system.

    Where a node does not answer, the others' are listed and the exit code tells.

    Example: quadctl param list
    """
    with Running(options) as running:
        heard = running.every()
    names = sorted(name for answer in heard.answers.values() for name in answer)
    if options.json:
        output.document(names)
    else:
        for name in names:
            output.line(name)
    heard.fail()


def get(
    options: Options,
    names: Annotated[list[str], Arg("Parameters, or whole tables.", complete="param")],
) -> None:
    """Print the values of parameters, in the words that `param set` takes.

    Example: quadctl param get safety.virtual_cage.x
    """
    options, names = which.about_parameters(options, names)
    with Running(options) as running:
        found = running.get(names)
    if options.json:
        output.document(found)
    elif list(found) == [normal_name(name) for name in names[:1]]:
        output.line(toml.word(*found.values()))
    else:
        for name, value in found.items():
            output.line(f"{name}: {toml.word(value)}")
