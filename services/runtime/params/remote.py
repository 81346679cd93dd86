"""Client of the parameters of a vehicle's nodes, for commands, programs and bridges."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf
from typing import Any

from msgspec import Struct

from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.services import GetParamsRequest, SetParamsRequest
from quadctl.schemas.topics import Service, get_params, set_params
from quadctl.services.runtime.concurrent import Answers, ask_each
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused

_NODES = ("dynamics", "pressure", "safety")
Values = dict[str, Any]
"""Values by dotted name."""


class RemoteParams:
    """Parameters of one vehicle's live nodes, also of its users' own.

    `call` calls a service, `endpoints` returns what the nodes offer; both block, and raise QuadctlError.
    """

    def __init__(
        self,
        call: Callable[[Service[Any, Any], Struct], Any],
        endpoints: Callable[[], Iterable[EndpointInfo]],
    ) -> None:
        self._call, self._endpoints = call, endpoints
        self.in_force: Values = {}
        """Values in force until the next standstill, for those read so far that wait for it."""
        self._last: Values = {}
        self._read_at, self._forgotten = -inf, 0
        self._lock = threading.Lock()

    def nodes(self) -> list[str]:
        """Return the live nodes that have parameters."""
        return sorted({offer.node for offer in self._endpoints() if offer.type == "GetParams"})

    def ask(self, wanted: Mapping[str, Sequence[str]]) -> Answers[Values]:
        """Return the answer of each node, with the values that are wanted of it, all without a name."""

        def ask(node: str) -> Values:
            reply = self._call(get_params(node), GetParamsRequest([*wanted[node]]))
            self.in_force |= reply.in_force
            values: Values = reply.values
            return values

        return ask_each(wanted, ask)

    def read(self, age: float = 0.0) -> Values:
        """Return the parameters of the nodes that answer, by dotted name.

        Those read within the last `age` s are not read again: programs ask for them by the hundred.
        """
        if time.monotonic() - self._read_at < age:
            return self._last
        values: Values = {}
        began, forgotten = time.monotonic(), self._forgotten
        # A node that is down has no parameters now; the others' stay within reach.
        for answer in self.ask({node: [] for node in self._nodes()}).answers.values():
            values |= answer
        with self._lock:
            # One that was set meanwhile may be among them with its value of before.
            self._last, self._read_at = values, began if forgotten == self._forgotten else -inf
        return values

    def _nodes(self) -> list[str]:
        """Return the live nodes with parameters, the lab's first: their names go before others'."""
        with contextlib.suppress(QuadctlError):
            return sorted(self.nodes(), key=lambda node: node not in _NODES)
        return []

    def forget(self) -> None:
        """Read all anew at the next time: somebody has set one."""
        with self._lock:
            self._read_at = -inf
            self._forgotten += 1

    def get(self, name: str) -> Any:
        """Return one parameter; raise QuadctlError if its node does not answer."""
        node = name.partition(".")[0]
        return self._call(get_params(node), GetParamsRequest([name])).values[name]

    def set(self, changes: Mapping[str, Any]) -> str:
        """Change parameters of one node, all or none; return why they wait for a standstill, if they do.

        Raises Refused if the node refuses them, Invalid if they are of several nodes.
        """
        nodes = {name.partition(".")[0] for name in changes}
        if len(nodes) > 1:
            raise Invalid("these are of several nodes: set one node's at a time")
        # The node itself refuses an unknown name, with the nearest one.
        is_known = nodes and (nodes <= set(_NODES) or nodes <= set(self._nodes()))
        node = nodes.pop() if is_known else _NODES[-1]
        reply = self._call(set_params(node), SetParamsRequest(dict(changes)))
        self.forget()
        if not reply.success:
            raise Refused(reply.reason, "see `quadctl param describe`")
        reason: str = reply.reason
        return reason
