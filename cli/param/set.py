"""`param set`: changes the parameters of a running node."""

from typing import Annotated

from cli import output, which
from cli.declare import Arg
from cli.options import Options
from cli.param.names import node_of
from cli.param.running import Running
from services.runtime.errors import Invalid, UsageError
from services.runtime.settings import toml
from services.runtime.settings.kept import UNSERVED
from services.runtime.settings.named import normal_name, value_of


def set_(
    options: Options,
    words: Annotated[
        list[str], Arg("A name and its value.", "NAME VALUE | NAME=VALUE...", complete="param")
    ],
) -> None:
    """Change parameters of one running node at once: all of them or none.

    Example: quadctl param set safety.virtual_cage.x 3
    """
    if len(words) == 2 and "=" not in words[0]:
        words = [f"{words[0]}={words[1]}"]
    if not all("=" in word for word in words):
        raise UsageError(
            "param set takes NAME VALUE or NAME=VALUE...",
            f"`quadctl param get {words[0]}` prints what it is" if len(words) == 1 else "",
        )
    options, words = which.about_parameters(options, words)
    pairs = (word.partition("=") for word in words)
    values = {normal_name(name): value_of(text) for name, _, text in pairs}
    nodes = {name.partition(".")[0] for name in values}
    if len(nodes) > 1:
        raise UsageError(
            f"these belong to different nodes: {', '.join(sorted(nodes))}",
            "set one node's parameters at a time, so that all are taken or none",
        )
    with Running(options) as running:
        if nodes <= set(UNSERVED):
            names = ", ".join(values)
            raise Invalid(f"{names} is fixed at launch", f"use `quadctl up --set {names}=...`")
        reply = running.set(node_of(next(iter(values)), running.nodes()), values)
    if not reply.success:
        names = " ".join(values)
        raise Invalid(
            f"nothing was changed: {reply.reason}",
            f"`quadctl param describe {names}` tells its bounds",
        )
    if options.json:
        output.document(values)
    else:
        for name, value in values.items():
            output.line(f"{name}: {toml.word(value)}")
