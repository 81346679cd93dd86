"""`graph`: the nodes, and the topics between them."""

from collections.abc import Iterator
from typing import Annotated, Any

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.cli.topic.info import nodes, rate
from quadctl.schemas.keyexpr import EndpointInfo


def graph(
    options: Options,
    dot: Annotated[bool, Option("Write the graph in Graphviz's language.")] = False,
) -> None:
    """Draw which nodes publish and subscribe to which topics, for all vehicles.

    Commands, e.g. `topic echo`, are no nodes and are not drawn.

    Example: quadctl graph --dot | dot -Tsvg -o graph.svg
    """
    vehicles, found = context.listing(options, "@pub", "@sub")
    topics = described(found)
    if options.json:
        output.document(topics)
    elif dot:
        output.line("\n".join(as_dot(topics)))
    else:
        rows = [
            (t["vehicle"], ", ".join(t["publishers"]) or "-", "-->", t["key"],
             rate(t["declared_hz"]), "-->", ", ".join(t["subscribers"]) or "-")
            for t in topics
        ]  # fmt: skip
        output.listing(vehicles, [("VEHICLE", "FROM", "", "TOPIC", "RATE", "", "TO"), *rows])


def described(found: list[EndpointInfo]) -> list[dict[str, Any]]:
    """Return each topic once, with its publishers and subscribers."""
    first = {each.key: each for each in sorted(found, key=lambda e: e.kind, reverse=True)}
    return [
        {
            "vehicle": first[key].vehicle,
            "key": key,
            "type": first[key].type,
            "declared_hz": first[key].hz,
            "publishers": nodes(found, "@pub", key),
            "subscribers": nodes(found, "@sub", key),
        }
        for key in sorted(first)
    ]


def as_dot(topics: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of a directed graph: nodes as ellipses, topics as boxes, a frame a vehicle."""
    yield "digraph quadctl {"
    yield "  rankdir=LR;"
    # From left to right, Graphviz puts the first frame at the bottom.
    for vehicle in sorted({topic["vehicle"] for topic in topics}, reverse=True):
        yield f"  subgraph {_quoted(f'cluster {vehicle}')} {{"
        yield f"    label={_quoted(vehicle)};"
        ours = [topic for topic in topics if topic["vehicle"] == vehicle]
        for node in sorted({n for t in ours for n in (*t["publishers"], *t["subscribers"])}):
            yield f"    {_node(vehicle, node)} [label={_quoted(node)}];"
        for topic in ours:
            box = _quoted(topic["key"])
            about = _quoted(f"{topic['key']}\n{rate(topic['declared_hz'])}")
            yield f"    {box} [shape=box, label={about}];"
            yield from (f"    {_node(vehicle, n)} -> {box};" for n in topic["publishers"])
            yield from (f"    {box} -> {_node(vehicle, n)};" for n in topic["subscribers"])
        yield "  }"
    yield "}"


def _node(vehicle: str, name: str) -> str:
    return _quoted(f"{vehicle} node {name}")


def _quoted(text: str) -> str:
    for special, written in (("\\", "\\\\"), ('"', '\\"'), ("\n", "\\n")):
        text = text.replace(special, written)
    return f'"{text}"'
