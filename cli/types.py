"""`type list` and `type show`."""

from collections.abc import Mapping
from typing import Annotated

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.cli.names import PARAMETERS, parts, types
from quadctl.schemas.topics import MESSAGES, SERVICES
from quadctl.schemas.typeinfo import definition, service_definition
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.names import nearest


def list_(options: Options) -> None:
    """List the types of the topics and services, and the types within them.

    Example: quadctl type list
    """
    names = sorted(definitions())
    output.either(options, names, "\n".join(names))


def show(
    options: Options,
    name: Annotated[str, Arg("A type, or the topic or service that has it.", complete="type")],
) -> None:
    """Show the fields of a type; name it, or a topic or service that has it, or its full key.

    Example: quadctl type show calibrate_pressure
    """
    known = types()
    found = type_of(name, known)
    if found is None:
        last = name.rpartition("/")[2]
        hint = nearest(last, known) or "`quadctl type list` shows them all"
        raise Invalid(f"there is no type {name}", hint)
    text = definitions()[found]
    output.either(options, {"name": found, "definition": text}, text)


def type_of(name: str, known: Mapping[str, str]) -> str | None:
    """Return the type that a name means, with or without a vehicle, node or package; or None."""
    bare = name.strip("/")
    rest, last = bare.partition("/")[2], bare.rpartition("/")[2]
    # Ignore the chunks of a package or a node, but not those of a topic's own name.
    free = last if last[:1].isupper() or last in {"get_params", "set_params"} else ""
    half = free.removesuffix("Request").removesuffix("Response")
    for spelling in (bare, rest, free, half):
        short = spelling.removeprefix("@srv/")
        if found := known.get(short) or known.get(short.lower()):
            return found
    return None


def definitions() -> dict[str, str]:
    """Return every type's definition, as text, by name."""
    texts = {name: definition(type_) for name, type_ in MESSAGES.items()}
    texts |= {name: definition(type_) for name, type_ in parts().items()}
    return texts | {
        service.type_name: service_definition(service.request, service.response)
        for service in (*SERVICES, *PARAMETERS)
    }
