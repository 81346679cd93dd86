"""`topic echo`: prints messages as they come."""

from typing import Annotated, Any

from cli import bus, output
from cli.declare import Arg, Opt
from cli.names import checked_key
from cli.options import Options
from cli.topic.shown import shown
from services.runtime.errors import Invalid


def echo(
    options: Options,
    topic: Annotated[str, Arg("A topic, or any Zenoh key or key expression.", complete="topic")],
    count: Annotated[int | None, Opt("End after so many messages.", ("-n",), min=1)] = None,
    field: Annotated[str, Opt("Show one field of each message, as position.z.")] = "",
) -> None:
    """Print messages as they come; ends when none comes within the timeout.

    Example: quadctl topic echo sensors/pressure -n 3
    """
    key = checked_key(topic, options.vehicle)
    with bus.connect(options) as client:
        stream = client.listen(key)
        seen = 0
        while count is None or seen < count:
            message = stream.next(client.timeout)
            if message is None:
                raise client.silent(key)
            value = _field(shown(message), field)
            if options.json:
                output.document(value)
            else:
                output.fields(value)
                if not field:
                    output.line("---")
            seen += 1


def _field(value: Any, path: str) -> Any:
    for part in filter(None, path.split(".")):
        if not isinstance(value, dict) or part not in value:
            has = ", ".join(value) if isinstance(value, dict) else "no fields"
            raise Invalid(f"the message has no field {path}", f"at {part} there is: {has}")
        value = value[part]
    return value
