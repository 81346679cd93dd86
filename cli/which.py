"""Which vehicle is meant by a name: a full key says it itself."""

from msgspec import structs

from cli.options import Options
from schemas.topics import TOPICS
from services.runtime import vehicles
from services.runtime.errors import UsageError


def about_topic(options: Options, name: str) -> Options:
    """The options, with the vehicle that a topic's full key names.

    For a key that is nobody's, or a pattern, it does not matter which of several vehicles asks.
    """
    bare = name.strip("/")
    if any(topic.name == bare for topic in TOPICS):
        return options
    there = _there(options)
    return _named(options, bare, there, there[0]) if len(there) > 1 else options


def anyone(options: Options) -> Options:
    """The options, with one of the vehicles where it does not matter which asks."""
    there = _there(options)
    return structs.replace(options, named=there[0]) if there else options


def about_service(options: Options, name: str) -> Options:
    """The options, with the vehicle that a service's full key names."""
    return _named(options, name.strip("/"), _there(options), "")


def about_parameters(options: Options, words: list[str]) -> tuple[Options, list[str]]:
    """The options with the vehicle that `uav1.safety.takeoff` names, and the words without it.

    So it is with `/uav1/safety/takeoff`; of a vehicle alone nothing is left, which is all that it
    has. A value may follow behind a `=`. Raises UsageError where the words name several.
    """
    first = {_dotted(word)[0].partition(".")[0] for word in words}
    if not (named := first & set(_there(options))):
        return options, words
    if len(first) > 1:
        raise UsageError(
            f"these belong to different vehicles: {', '.join(sorted(first))}",
            "ask about one vehicle's parameters at a time",
        )
    vehicle = named.pop()
    return structs.replace(options, named=vehicle), [
        name.removeprefix(vehicle).removeprefix(".") + value for name, value in map(_dotted, words)
    ]


def about_node(options: Options, name: str) -> tuple[Options, str]:
    """The options with the vehicle that `/uav1/safety` names, and the node's own name."""
    vehicle, _, node = name.strip("/").partition("/")
    if not node or vehicle not in _there(options):
        return options, name
    return structs.replace(options, named=vehicle), node


def _dotted(word: str) -> tuple[str, str]:
    """A parameter's name with dots for slashes, and its value with the `=` before it."""
    name, equals, value = word.partition("=")
    return name.strip("/").replace("/", "."), f"{equals}{value}"


def _there(options: Options) -> list[str]:
    if options.named:
        return [options.named]
    return vehicles.of(options.realm, options.connect, options.timeout)


def _named(options: Options, bare: str, there: list[str], otherwise: str) -> Options:
    first = bare.partition("/")[0]
    named = first if first in there else otherwise
    return structs.replace(options, named=named) if named else options
