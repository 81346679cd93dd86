"""Judges who has announced itself, what each serves, and whether it answers; pure."""

from collections.abc import Iterator
from typing import Any

from msgspec import Struct

from cli.doctor.check import Check, alone, failed, passed, warned
from schemas.topics import SERVICES, TOPICS, Service, get_params, set_params
from schemas.typeinfo import schema_hash
from services.runtime.bus.survey import Survey
from services.runtime.errors import TimedOut
from services.runtime.process_table import NODES
from services.runtime.run_files import RunRecord

_SERVED: tuple[Service[Any, Any], ...] = (*SERVICES, get_params(""), set_params(""))
_TYPES: dict[str, type[Struct]] = {topic.type.__name__: topic.type for topic in TOPICS}
_TYPES |= {service.type_name: service.request for service in _SERVED}
_HASHES = {name: schema_hash(type_) for name, type_ in _TYPES.items()}


def announced(found: Survey, run: RunRecord | None) -> Check:
    """Every node that is recorded as ready has announced itself, and offers what is its own."""
    due = [node.name for node in run.nodes if node.state == "ready"] if run else []
    missing = [name for name in due if name not in found.nodes and name in NODES]
    if missing:
        return failed(
            "announced",
            f"not on the bus: {', '.join(missing)}",
            f"`quadctl node restart {missing[0]}`",
        )
    if not found.nodes:
        return failed("announced", "no node is on the bus", "`quadctl up -d`")
    offered = {offer.name for offer in found.offers}
    declared: tuple[Any, ...] = (*SERVICES, *TOPICS)
    lacking = [
        f"{entry.node} does not offer {entry.name}"
        for entry in declared
        if entry.node in found.nodes and entry.name not in offered
    ]
    if lacking:
        return warned(
            "announced",
            ", ".join(lacking),
            "add it to your own node, or take ours: see [processes] in quad.toml",
        )
    return passed("announced", ", ".join(found.nodes))


def schemas(found: Survey) -> Check:
    """Every type of ours that is offered has our fields."""
    others = sorted({
        f"{offer.node} has {offer.type}#{offer.hash}, here it is #{_HASHES[offer.type]}"
        for offer in found.offers
        if offer.hash != _HASHES.get(offer.type, offer.hash)
    })  # fmt: skip
    if others:
        return failed(
            "schemas",
            "\n".join(others),
            "install the same version on both sides: `quadctl --version`, then `quadctl up -d`",
        )
    return passed("schemas", f"{len(found.offers)} topics and services have the fields known here")


def servers(found: Survey) -> Check:
    """One server for each service: announced, and by who answers a call."""
    doubled: list[str] = []
    offers = [offer for offer in found.offers if offer.kind == "@srv"]
    for key in sorted({offer.key for offer in offers}):
        nodes = [offer.node for offer in offers if offer.key == key]
        answering = {answer.server for answer in found.answers.get(key, ()) if answer.server}
        if len(nodes) > 1:
            doubled.append(f"{key} is served by {' and '.join(nodes)}")
        elif len(answering) > 1:
            doubled.append(
                f"{key} is served by {nodes[0]} and {len(answering) - 1} more, not announced"
            )
    keys = {offer.key for offer in offers}
    return alone("servers", doubled, f"one for each of {len(keys)} services")


def services(found: Survey) -> Iterator[Check]:
    """The services of each node answer."""
    keys = {offer.key: offer for offer in found.offers if offer.key in found.answers}
    for node in sorted({offer.node for offer in keys.values()}):
        yield _services(node, [key for key, offer in keys.items() if offer.node == node], found)


def _services(node: str, keys: list[str], found: Survey) -> Check:
    title, names = f"services of {node}", {o.key: o.name for o in found.offers}
    silent = [
        names[key] for key in keys if not [a for a in found.answers[key] if a.code != TimedOut.code]
    ]
    if silent:
        return failed(
            title,
            f"no answer within {found.listened:.1f} s from {', '.join(silent)}",
            f"`quadctl node logs {node}`, `quadctl node restart {node}`",
        )
    internal = [names[key] for key in keys if any(a.code == "internal" for a in found.answers[key])]
    if internal:
        return failed(title, f"fails inside: {', '.join(internal)}", f"`quadctl node logs {node}`")
    longest = max(answer.seconds for key in keys for answer in found.answers[key])
    said = ", ".join(names[key].removeprefix(f"{node}/") for key in keys)
    return passed(title, f"{said} answer within {1000 * longest:.1f} ms")
