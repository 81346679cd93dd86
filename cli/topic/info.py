"""`topic list` and `topic info`."""

from typing import Annotated, Any

from msgspec import structs

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_topic, own_topic
from quadctl.cli.declarations import Arg
from quadctl.cli.names import live_key, single_key
from quadctl.schemas.keyexpr import EndpointInfo, Kind
from quadctl.schemas.topics import MESSAGES, Topic
from quadctl.services.runtime.errors import Unreachable
from quadctl.services.runtime.params.names import nearest


def list_(options: Options) -> None:
    """List the topics of all vehicles with their type, publisher, declared rate and subscribers.

    An input that no node publishes, e.g. `input/position_request`, has no publisher.

    Example: quadctl topic list
    """
    vehicles, found = context.listing(options, "@pub", "@sub")
    topics: list[dict[str, Any]] = [
        {"vehicle": o.vehicle, "key": o.key, "type": o.type, "node": o.node, "declared_hz": o.hz,
         "hash": o.hash, "subscribers": nodes(found, "@sub", o.key)}
        for o in _by_publisher(found)
    ]  # fmt: skip
    if options.json:
        output.document(topics)
        return
    rows = [
        (t["vehicle"], t["key"], t["type"], t["node"] or "-", rate(t["declared_hz"]),
         ", ".join(t["subscribers"]) or "-")
        for t in topics
    ]  # fmt: skip
    title = ("VEHICLE", "TOPIC", "TYPE", "NODE", "RATE", "SUBSCRIBERS")
    output.listing(vehicles, [title, *rows])


def nodes(found: list[EndpointInfo], kind: Kind, key: str) -> list[str]:
    """Return the nodes that publish (`@pub`) or subscribe to (`@sub`) a topic."""
    return sorted({each.node for each in found if (each.kind, each.key) == (kind, key)})


def rate(hz: float) -> str:
    """Format a declared rate."""
    return f"{hz:g} Hz" if hz else "on change"


def _by_publisher(found: list[EndpointInfo]) -> list[EndpointInfo]:
    """Return a row for each publisher of a topic, or one without a node if there is none."""
    published = {each.key for each in found if each.kind == "@pub"}
    awaited = {each.key: each for each in found if each.key not in published}
    return [
        each if each.kind == "@pub" else structs.replace(each, node="")
        for each in found
        if each.kind == "@pub" or awaited.get(each.key) is each
    ]


_LISTENERS = {True: "at least one", False: "none", None: "shown only to a publisher"}


def info(options: Options, topic: Annotated[str, Arg("A topic or key.", complete="topic")]) -> None:
    """Show a topic's type, rate, publishers, subscribers and fields, and whether it has listeners.

    Subscribers are nodes; a listener may also be a command, e.g. `topic echo`, or a program.

    Example: quadctl topic info sensors/pressure
    """
    options = about_topic(options, topic)
    key = single_key(topic, options.vehicle)
    with context.connect(options) as client:
        key = live_key(client, key)
        outlet = client.raw_publisher(key) if _may_publish(options, key) else None
        # A round trip to the hub: after it, the listeners are known, too.
        offers = client.endpoints("@pub", "@sub")
        # Over a network a hub shows listeners only to clients that may publish.
        has_listener = outlet.has_subscribers() if outlet else None
        ours = own_topic(key, options.vehicle)
        found = sorted((o for o in offers if o.key == key), key=lambda o: o.kind)
        if not found and not (ours and has_listener):
            keys = {offer.key for offer in offers}
            hint = nearest(key, keys) or nearest(key, {each.partition("/")[2] for each in keys})
            problem = _no_publisher(key, hint, has_listener=bool(has_listener))
            raise client.explained(problem, ours.node if ours else "")
    document = _described(key, found, ours) | {"listened": has_listener}
    if options.json:
        output.document(document)
        return
    output.table(_rows(document, ours.doc if ours else ""))
    output.line(document["definition"] or "its fields are not known to this quadctl")


def _may_publish(options: Options, key: str) -> bool:
    if not options.connect:
        return True
    from quadctl.services.runtime.security import permissions

    return permissions.allows(options.connect, "publish", key)


def _described(key: str, found: list[EndpointInfo], ours: Topic[Any] | None) -> dict[str, Any]:
    """Describe a topic as its nodes announce it, publishers first, else as our contract does."""
    from quadctl.schemas.digests import go_together
    from quadctl.schemas.typeinfo import definition
    from quadctl.services.runtime.bus.codec import digest as digest_of

    type_: Any
    if found:
        name, digest, hz = found[0].type, found[0].hash, found[0].hz
        type_ = MESSAGES.get(name)
    else:
        assert ours is not None  # noqa: S101 - the caller's promise
        type_, hz = ours.type, ours.hz
        name, digest = type_.__name__, digest_of(type_)
    fields = definition(type_) if type_ and go_together(digest_of(type_), digest) else ""
    return {
        "key": key,
        "type": name,
        "hash": digest,
        "declared_hz": hz,
        "publishers": nodes(found, "@pub", key),
        "subscribers": nodes(found, "@sub", key),
        "definition": fields,
    }


def _rows(document: dict[str, Any], about: str) -> list[tuple[str, str]]:
    hz, none = document["declared_hz"], "none that is announced"
    rows = [
        ("Key:", document["key"]),
        ("Type:", f"{document['type']}, hash {document['hash']}"),
        ("Rate:", f"{rate(hz)}, declared" if hz else rate(hz)),
        ("Publishers:", ", ".join(document["publishers"]) or none),
        ("Subscribers:", ", ".join(document["subscribers"]) or none),
        ("Listeners:", _LISTENERS[document["listened"]]),
    ]
    return [*rows, ("About:", about)] if about else rows


def _no_publisher(key: str, hint: str, *, has_listener: bool) -> Unreachable:
    return Unreachable(
        f"no node publishes {key} now" + (", but it has a listener" if has_listener else ""),
        hint or "`quadctl topic list` shows what there is",
    )
