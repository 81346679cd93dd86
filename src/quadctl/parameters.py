"""The parameters of the running system, read and set under one deadline."""

import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from msgspec import Struct

from quadctl.schemas.services import SetParamsRequest, SetParamsResponse
from quadctl.schemas.topics import Service, set_params
from quadctl.services.runtime import run_files
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.concurrent import Answers
from quadctl.services.runtime.errors import Invalid, QuadctlError, Unreachable
from quadctl.services.runtime.params.names import flatten, nearest, normal_name
from quadctl.services.runtime.params.remote import RemoteParams, Values
from quadctl.services.runtime.process_table import NODES
from quadctl.services.runtime.run_files import UNSERVED, not_running
from quadctl.services.runtime.typed import argument, plain


def node_of(name: str, live: list[str]) -> str:
    """Return a parameter's node, live or one of the lab's; raise Invalid with the nearest name."""
    node = name.partition(".")[0]
    if node in live or node in NODES or not live:
        return node
    hint = nearest(node, live) or f"the nodes with parameters are {', '.join(live)}"
    raise Invalid(f"there is no parameter {name}: no node {node} is up", hint)


ALL = ""
"""Normal form of `/`: the parameters of every node."""


def tables() -> tuple[str, ...]:
    """Return every table of the file; only commands that need them pay for the import."""
    from quadctl.schemas.params import Params

    return Params.__struct_fields__


class RunningParams:
    """Access to the parameters of a client's vehicle; all calls together end by a deadline.

    The deadline is monotonic s; by default it is the client's timeout from now.
    """

    def __init__(self, client: Client, deadline: float | None = None) -> None:
        self._client = client
        self._deadline = time.monotonic() + client.timeout if deadline is None else deadline
        self._remote = RemoteParams(self._call, client.endpoints)

    @property
    def in_force(self) -> Values:
        """Return the values in force until the next standstill, for those read that wait for it."""
        return self._remote.in_force

    def nodes(self) -> list[str]:
        """Return the live nodes that have parameters."""
        return self._remote.nodes()

    def answered(self) -> Values:
        """Return the values of the nodes that answer."""
        return self._remote.read()

    def get(self, names: Iterable[str]) -> Values:
        """Return values by leaf or by table, in the given order; raise if one is not available."""
        names = [normal_name(name) for name in names]
        if ALL in names:
            return _all_of(self.every())
        live = self.nodes()
        wanted: dict[str, list[str]] = {}
        for name in names:
            if name.partition(".")[0] not in UNSERVED:
                wanted.setdefault(node_of(name, live), []).append(name)
        found = _all_of(self._remote.ask(wanted))
        if any(name.partition(".")[0] in UNSERVED for name in names):
            found |= self._kept(UNSERVED)
        return {leaf: found[leaf] for name in names for leaf in leaves_of(found, name)}

    def every(self) -> Answers[Values]:
        """Return each node's answer, users' own nodes included, and the supervisor's tables."""
        live = self.nodes()
        # Asked last: a node that the hub loses in between is then in both lists, not in neither.
        frozen = [process.name for process in self._client.silent_processes()]
        results = self._remote.ask({node: [] for node in sorted({*live, *frozen})})
        results.answers[""] = self._kept(UNSERVED)
        return results

    def declared(self, wanted: Collection[str]) -> Answers[Values]:
        """Return each node's answer for tables of the file.

        A node that does not run has the values that it would start with. On another machine these
        are unknown, and so are the supervisor's own tables.
        """
        served = [node for node in self.nodes() if node in wanted and node not in UNSERVED]
        results = self._remote.ask({node: [] for node in served})
        results.answers[""] = self._kept([name for name in wanted if name not in served])
        return results

    def whole(self) -> Values:
        """Return every declared parameter, in the file's order; raise if a node does not answer."""
        from quadctl.services.runtime.params.catalogue import declared

        found = declared(_all_of(self.declared(tables())))
        return {leaf: found[leaf] for name in tables() for leaf in found if _in(name, leaf)}

    def set(self, node: str, values: Values) -> SetParamsResponse:
        """Change a node's parameters: all of them or none."""
        reply: SetParamsResponse = self._call(set_params(node), SetParamsRequest(values))
        return reply

    def absent(self, node: str) -> QuadctlError:
        """Return the error for a node that should have parameters and is not live."""
        text = f"nothing was changed: no live node takes the parameters of {node}"
        problem = Unreachable(text, f"is {node} up? `quadctl node list` shows it")
        return self._client.explained(problem, node)

    def _call(self, service: Service[Any, Any], request: Struct) -> Any:
        return self._client.call(service, request, self._left())

    def _kept(self, wanted: Collection[str]) -> Values:
        """Return the values of tables from the realm's folder; none if it has none."""
        if not self._client.is_local:
            return {}
        realm = self._client.realm
        try:
            stored = run_files.tables(realm, self._client.vehicle)
        except FileNotFoundError as error:
            raise not_running(realm) from error
        # `processes` may be absent.
        return dict(flatten({name: stored[name] for name in wanted if stored.get(name)}))

    def _left(self) -> float:
        return max(self._deadline - time.monotonic(), 0.001)


def _all_of(results: Answers[Values]) -> Values:
    results.fail()
    return {name: value for answer in results.answers.values() for name, value in answer.items()}


def leaves_of(found: Mapping[str, Any], name: str) -> list[str]:
    """Return a parameter, or a table's, among known names; raise Invalid with the nearest name."""
    leaves = [leaf for leaf in found if _in(name, leaf)]
    if not leaves:
        from quadctl.services.runtime.params.load import nearest_declared

        raise Invalid(f"there is no parameter {name}", nearest_declared(name))
    return leaves


def _in(table: str, leaf: str) -> bool:
    return leaf == table or leaf.startswith(f"{table}.")


class ParamTable:
    """Parameters of a running vehicle by dotted name, e.g. `table["safety.virtual_cage.x"] = 3.0`.

    A table's name reads all its values, as a dict by leaf. Reading raises Invalid, with the nearest
    name, for an unknown one; setting raises Invalid if a node refuses, and then changes nothing.
    """

    def __init__(self, client: Client) -> None:
        self._client = client

    def __getitem__(self, name: str) -> Any:
        argument("a parameter's name", name, str, "a text")
        found = RunningParams(self._client).get([name])
        return found.get(name, found)

    def __setitem__(self, name: str, value: Any) -> None:
        self.update({name: value})

    def __repr__(self) -> str:
        return f"<parameters of {self._client.vehicle} in the realm {self._client.realm.name}>"

    def __iter__(self) -> Iterator[str]:
        return iter(RunningParams(self._client).get(["/"]))

    def update(self, values: Mapping[str, Any]) -> None:
        """Change parameters: all of them or none, of several nodes, too."""
        argument("the values", values, Mapping, "a table by dotted name")
        running = RunningParams(self._client)
        live = running.nodes()
        by_node: dict[str, Values] = {}
        for name, value in values.items():
            argument("a parameter's name", name, str, "a text")
            if name.partition(".")[0] in UNSERVED:
                raise Invalid(f"{name} is fixed at launch", "give it to `launch(params=...)`")
            by_node.setdefault(node_of(name, live), {})[name] = plain(value)
        before = running.get(values) if len(by_node) > 1 else {}
        done: list[str] = []
        for node, wanted in by_node.items():
            reply = running.set(node, wanted)
            if not reply.success:
                for changed in done:
                    running.set(changed, {name: before[name] for name in by_node[changed]})
                reason = reply.reason.removeprefix("param set: ")
                hint = "`quadctl param describe` shows names and bounds"
                raise Invalid(f"nothing was changed: {reason}", hint)
            done.append(node)
