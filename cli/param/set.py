"""`param set`: a change to the parameters of a running node."""

from typing import Annotated

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.cli.values import parameter
from quadctl.parameters import node_of, tables
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.names import flatten, normal_name
from quadctl.services.runtime.params.remote import Values
from quadctl.services.runtime.run_files import UNSERVED


def set_(
    options: Options,
    words: Annotated[
        list[str], Arg("A name and its value.", "NAME VALUE | NAME=VALUE...", complete="param")
    ],
) -> None:
    """Change parameters of one running node at once: all of them or none.

    Of a vehicle in flight, body, gains and limits change at its next standstill.

    Example: quadctl param set safety.virtual_cage.x 3
    """
    if len(words) == 2 and "=" not in words[0]:
        words = [f"{words[0]}={words[1]}"]
    elif len(words) == 3 and "=" not in words[0] + words[1] and words[1][:1].isalpha():
        # As in ROS 2: the node, its parameter, the value.
        words = [f"{words[0].strip('/')}.{words[1]}={words[2]}"]
    # Slashes alone before the = name everything, and no parameter.
    if not all("=" in word.lstrip("/=") for word in words):
        hint = f"`quadctl param get {words[0]}` prints its value" if len(words) == 1 else ""
        if len(words) > 2 and words[1].startswith(("[", "{")):
            hint = (
                f"quote a list or a table: `quadctl param set {words[0]} '{' '.join(words[1:])}'`"
            )
        raise UsageError("param set takes NAME VALUE or NAME=VALUE...", hint)
    options, words = context.about_parameters(options, words)
    pairs = (word.partition("=") for word in words)
    values = {normal_name(name): parameter(text) for name, _, text in pairs}
    nodes = {name.partition(".")[0] for name in values}
    if len(nodes) > 1:
        raise UsageError(
            f"these belong to different nodes: {', '.join(sorted(nodes))}",
            "set one node's parameters at a time, so that all are accepted or none",
        )
    with context.running_params(options) as running:
        if nodes <= set(UNSERVED):
            names = ", ".join(values)
            raise Invalid(f"{names} is fixed at launch", f"use `quadctl up --set {names}=...`")
        reply = running.set(node_of(next(iter(values)), running.nodes()), values)
    if not reply.success:
        reason = reply.reason.removeprefix("param set: ")
        raise Invalid(f"nothing was changed: {reason}", _hint(values))
    if options.json:
        output.document(values | ({"waits": reply.waits} if reply.waits else {}))
        return
    for name, value in values.items():
        waits = any(leaf == name or leaf.startswith(f"{name}.") for leaf in reply.waits)
        when = " (from the next standstill)" if waits else ""
        output.line(f"{name}: {catalogue.word(value)}{when}")
    if told := reply.reason.removeprefix("from the next standstill").removeprefix("; "):
        output.note(told)


def _hint(values: Values) -> str:
    """Return the hint for values that a node has refused; its reason only names the fault."""
    leaves = {normal_name(name): value for name, value in flatten(values)}
    if switch := next(filter(None, map(catalogue.live_switch, leaves)), ""):
        return f"{switch} changes it at once"
    fixed = [name for name in leaves if catalogue.fixed_at_launch(name)]
    if fixed:
        settings = " ".join(f"--set {name}={catalogue.word(leaves[name])}" for name in fixed)
        return f"it takes a new run: `quadctl down`, then `quadctl up {settings}`"
    if leaves.keys() <= catalogue.leaves().keys() | catalogue.tables().keys():
        return f"`quadctl param describe {' '.join(leaves)}` shows the bounds"
    # The parameters of a user's own node have no description.
    ours = next(iter(leaves)).partition(".")[0] in tables()
    return "`quadctl param list` shows those that there are" if ours else ""
