"""`type list|show`: the wire contract; needs no running system."""

from typing import Annotated

import typer

from cli import options, output
from cli.options import Command
from services.runtime.errors import Invalid

app = typer.Typer(help="Messages and services, field by field.")


def _definitions() -> dict[str, str]:
    from schemas.describe import definition, service_definition
    from schemas.topics import SERVICES, TOPICS, get_params, set_params

    services = (*SERVICES, get_params("NODE"), set_params("NODE"))
    return {topic.type.__name__: definition(topic.type) for topic in TOPICS} | {
        service.type_name: service_definition(service.request, service.response)
        for service in services
    }


def _spellings() -> dict[str, str]:
    """Every name that a type may be asked for by, to its own."""
    from schemas.topics import SERVICES, TOPICS

    known = {name: name for name in _definitions()}
    known |= {name.lower(): name for name in known}
    known |= {service.name: service.type_name for service in SERVICES}
    return known | {topic.name: topic.type.__name__ for topic in TOPICS}


@app.command("list", cls=Command)
def list_(ctx: typer.Context) -> None:
    """List the types of the topics and services.

    Example: quadctl type list
    """
    names = sorted(_definitions())
    if options.of(ctx).json:
        output.document(names)
    else:
        for name in names:
            output.line(name)


@app.command(cls=Command)
def show(ctx: typer.Context, name: Annotated[str, typer.Argument()]) -> None:
    """Show the fields of a type, by its name or by that of a topic or service.

    Example: quadctl type show calibrate_pressure
    """
    from services.runtime.params import nearest

    spellings = _spellings()
    found = spellings.get(name.strip("/")) or spellings.get(name.strip("/").lower())
    if found is None:
        hint = nearest(name, spellings) or "`quadctl type list` shows them all"
        raise Invalid(f"there is no type {name}", hint)
    text = _definitions()[found]
    if options.of(ctx).json:
        output.document({"name": found, "definition": text})
    else:
        output.line(text)
