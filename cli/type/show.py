"""`type list|show`: the wire contract; needs no running system."""

from typing import Annotated

from cli import output
from cli.declare import Arg
from cli.names import types
from cli.options import Options
from schemas.describe import definition, service_definition
from schemas.topics import SERVICES, TOPICS, get_params, set_params
from services.runtime.errors import Invalid
from services.runtime.settings.named import nearest


def list_(options: Options) -> None:
    """List the types of the topics and services.

    Example: quadctl type list
    """
    names = sorted(definitions())
    if options.json:
        output.document(names)
    else:
        for name in names:
            output.line(name)


def show(
    options: Options,
    name: Annotated[str, Arg("A type, or the topic or service that has it.", complete="type")],
) -> None:
    """Show the fields of a type, by its name or by that of a topic or service.

    Example: quadctl type show calibrate_pressure
    """
    spellings = types()
    found = spellings.get(name.strip("/")) or spellings.get(name.strip("/").lower())
    if found is None:
        hint = nearest(name, spellings) or "`quadctl type list` shows them all"
        raise Invalid(f"there is no type {name}", hint)
    text = definitions()[found]
    output.either(options, {"name": found, "definition": text}, text)


def definitions() -> dict[str, str]:
    """Every type by its name, as text."""
    services = (*SERVICES, get_params("NODE"), set_params("NODE"))
    return {topic.type.__name__: definition(topic.type) for topic in TOPICS} | {
        service.type_name: service_definition(service.request, service.response)
        for service in services
    }
