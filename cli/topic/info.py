"""`topic list` and `topic info`."""

from typing import Annotated, Any

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_topic, own_topic
from quadctl.cli.declarations import Arg
from quadctl.cli.names import live_key, single_key
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.topics import MESSAGES, Topic
from quadctl.services.runtime.errors import Unreachable
from quadctl.services.runtime.params.names import nearest


def list_(options: Options) -> None:
    """List the live topics with their type, node and declared rate.

    Example: quadctl topic list
    """
    with context.connect(options) as client:
        offers = [offer for offer in client.endpoints() if offer.kind == "@pub"]
    if options.json:
        output.document([
            {"key": o.key, "type": o.type, "node": o.node, "declared_hz": o.hz, "hash": o.hash}
            for o in offers
        ])  # fmt: skip
        return
    rows = [(o.key, o.type, o.node, f"{o.hz:g} Hz" if o.hz else "on change") for o in offers]
    output.table([("TOPIC", "TYPE", "NODE", "RATE"), *rows])


_LISTENERS = {True: "at least one", False: "none", None: "shown only to a publisher"}


def info(options: Options, topic: Annotated[str, Arg("A topic or key.", complete="topic")]) -> None:
    """Show a topic's type, rate, publishers and fields, and whether it has listeners.

    The bus names a topic's publishers, but not its listeners.

    Example: quadctl topic info sensors/pressure
    """
    options = about_topic(options, topic)
    key = single_key(topic, options.vehicle)
    with context.connect(options) as client:
        key = live_key(client, key)
        outlet = client.raw_publisher(key) if _may_publish(options, key) else None
        # A round trip to the hub: after it, the listeners are known, too.
        offers = [offer for offer in client.endpoints() if offer.kind == "@pub"]
        # Over a network a hub shows listeners only to clients that may publish.
        has_listener = outlet.has_subscribers() if outlet else None
        ours = own_topic(key, options.vehicle)
        found = [offer for offer in offers if offer.key == key]
        if not found and not (ours and has_listener):
            problem = _no_publisher(key, offers, has_listener=bool(has_listener))
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
    """Describe a topic as its publishers announce it or, without any, as our contract does."""
    from quadctl.schemas.typeinfo import definition, schema_hash

    type_: Any
    if found:
        name, digest, hz = found[0].type, found[0].hash, found[0].hz
        type_ = MESSAGES.get(name)
    else:
        assert ours is not None  # noqa: S101 - the caller's promise
        type_, hz = ours.type, ours.hz
        name, digest = type_.__name__, schema_hash(type_)
    fields = definition(type_) if type_ and schema_hash(type_) == digest else ""
    return {
        "key": key,
        "type": name,
        "hash": digest,
        "declared_hz": hz,
        "publishers": sorted({offer.node for offer in found}),
        "definition": fields,
    }


def _rows(document: dict[str, Any], about: str) -> list[tuple[str, str]]:
    hz = document["declared_hz"]
    rows = [
        ("Key:", document["key"]),
        ("Type:", f"{document['type']}, hash {document['hash']}"),
        ("Rate:", f"{hz:g} Hz, declared" if hz else "on change"),
        ("Publishers:", ", ".join(document["publishers"]) or "none that is announced"),
        ("Listeners:", _LISTENERS[document["listened"]]),
    ]
    return [*rows, ("About:", about)] if about else rows


def _no_publisher(key: str, offers: list[EndpointInfo], *, has_listener: bool) -> Unreachable:
    return Unreachable(
        f"no node publishes {key} now" + (", but it has a listener" if has_listener else ""),
        nearest(key, {offer.key for offer in offers}) or "`quadctl topic list` shows what there is",
    )
