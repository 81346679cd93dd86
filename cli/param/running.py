"""The parameters of the running system, read and set under one deadline."""

import time
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Self

from quadctl.cli import context
from quadctl.cli.concurrent import Answers, ask_each
from quadctl.cli.context import Options
from quadctl.schemas.services import GetParamsRequest, SetParamsRequest, SetParamsResponse
from quadctl.schemas.topics import get_params, set_params
from quadctl.services.runtime import run_files
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import Invalid, QuadctlError, Unreachable
from quadctl.services.runtime.params.names import flatten, nearest, normal_name
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import UNSERVED, not_running


def nodes_with_params(client: Client) -> list[str]:
    """The live nodes that have parameters."""
    return sorted({offer.node for offer in client.endpoints() if offer.type == "GetParams"})


def node_of(name: str, live: list[str]) -> str:
    """The one of the live nodes that a parameter belongs to; raises Invalid with the nearest name.

    A node of ours may just be away.
    """
    node = name.partition(".")[0]
    if node in live or node in NODES or not live:
        return node
    hint = nearest(node, live) or f"the nodes with parameters are {', '.join(live)}"
    raise Invalid(f"there is no parameter {name}: no node {node} is up", hint)


Values = dict[str, Any]
"""By dotted name."""
ALL = ""
"""What `/` names: the parameters of every node."""


def tables() -> tuple[str, ...]:
    """Every table of the file; only some commands need to know them, and pay for the import."""
    from quadctl.schemas.params import Params

    return Params.__struct_fields__


class RunningParams:
    """Asks within a `with` block. All of it together takes no longer than --timeout."""

    def __init__(self, options: Options) -> None:
        """Connect; raises Unreachable where nothing runs."""
        self._options = options
        self._deadline = time.monotonic() + options.timeout
        self._client = context.connect(options)
        self.in_force: Values = {}
        """Of the values read so far, what holds in place of those that wait for a standstill."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.__exit__()

    def nodes(self) -> list[str]:
        """The live nodes that have parameters."""
        return nodes_with_params(self._client)

    def get(self, names: Iterable[str]) -> Values:
        """Values by leaf or by table, in the order asked for; raises where one is not to be had."""
        names = [normal_name(name) for name in names]
        if ALL in names:
            return _all_of(self.every())
        live = self.nodes()
        wanted: dict[str, list[str]] = {}
        for name in names:
            if name.partition(".")[0] not in UNSERVED:
                wanted.setdefault(node_of(name, live), []).append(name)
        found = _all_of(self._ask(wanted))
        if any(name.partition(".")[0] in UNSERVED for name in names):
            found |= self._kept(UNSERVED)
        return {leaf: found[leaf] for name in names for leaf in leaves_of(found, name)}

    def every(self) -> Answers[Values]:
        """What each node answers, users' own among them, and the supervisor's own tables."""
        live = self.nodes()
        # Looked for last: one that the hub loses between the two is then in both, not in neither.
        frozen = [process.name for process in self._client.silent_processes()]
        heard = self._ask({node: [] for node in sorted({*live, *frozen})})
        heard.answers[""] = self._kept(UNSERVED)
        return heard

    def declared(self, wanted: Collection[str]) -> Answers[Values]:
        """What each node answers for tables of the file.

        Of a node that does not run it is what it would start with. Nothing is known of those,
        nor of the supervisor's own tables, where the run is on another machine.
        """
        served = [node for node in self.nodes() if node in wanted and node not in UNSERVED]
        heard = self._ask({node: [] for node in served})
        heard.answers[""] = self._kept([name for name in wanted if name not in served])
        return heard

    def whole(self) -> Values:
        """Every parameter, in the file's order; raises where a node does not answer."""
        found = _all_of(self.declared(tables()))
        return {leaf: found[leaf] for name in tables() for leaf in found if _in(name, leaf)}

    def set(self, node: str, values: Values) -> SetParamsResponse:
        """Change a node's parameters: all of them or none."""
        return self._client.call(set_params(node), SetParamsRequest(values), self._left())

    def absent(self, node: str) -> QuadctlError:
        """Why a node that has parameters does not take them."""
        problem = Unreachable(
            f"nothing was changed: nobody takes the parameters of {node}",
            f"is {node} up? `quadctl node list` shows it",
        )
        return self._client.explained(problem, node)

    def _ask(self, wanted: dict[str, list[str]]) -> Answers[Values]:
        def ask(node: str) -> Values:
            request = GetParamsRequest(wanted[node])
            reply = self._client.call(get_params(node), request, self._left())
            self.in_force |= reply.in_force
            return reply.values

        return ask_each(wanted, ask)

    def _kept(self, wanted: Collection[str]) -> Values:
        """What the realm's folder says of tables; nothing where it says nothing."""
        if self._options.connect:
            return {}
        realm = Realm(self._options.realm)
        try:
            there = run_files.tables(realm, self._options.vehicle)
        except FileNotFoundError as error:
            raise not_running(realm) from error
        # Of `processes` there may be nothing to say.
        return dict(flatten({name: there[name] for name in wanted if there.get(name)}))

    def _left(self) -> float:
        return max(self._deadline - time.monotonic(), 0.001)


def _all_of(heard: Answers[Values]) -> Values:
    heard.fail()
    return {name: value for answer in heard.answers.values() for name, value in answer.items()}


def leaves_of(found: Mapping[str, Any], name: str) -> list[str]:
    """A parameter, or those of a table, among known names; raises Invalid with the nearest name."""
    leaves = [leaf for leaf in found if _in(name, leaf)]
    if not leaves:
        from quadctl.services.runtime.params.load import nearest_declared

        raise Invalid(f"there is no parameter {name}", nearest_declared(name))
    return leaves


def _in(table: str, leaf: str) -> bool:
    return leaf == table or leaf.startswith(f"{table}.")
