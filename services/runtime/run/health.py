"""Who has announced itself and who still answers, as the supervisor sees it over the bus."""

import threading
from collections.abc import Callable, Sequence

import zenoh

from schemas.requests import GetParamsRequest
from schemas.topics import get_params
from services.runtime.bus import graph, wire
from services.runtime.bus.session import Address, open_client
from services.runtime.errors import Unreachable

Post = Callable[[Callable[[], None]], None]


class Health:
    """Connects on a thread of its own, because the hub may be long in coming.

    A process is there when its node of every vehicle is; since these live and die together, the
    first vehicle's is asked whether it answers. `on_ready(name)` and `on_answer(name)` are posted to the supervisor's loop.
    """

    def __init__(
        self,
        address: Address,
        vehicles: Sequence[str],
        post: Post,
        on_ready: Callable[[str], None],
        on_answer: Callable[[str], None],
    ) -> None:
        self._address, self._vehicles, self._post = address, frozenset(vehicles), post
        self._pinged, self._seen = vehicles[0], dict[str, set[str]]()
        self._on_ready, self._on_answer = on_ready, on_answer
        self._session: zenoh.Session | None = None
        self._tokens: zenoh.Subscriber[None] | None = None
        threading.Thread(target=self._connect, daemon=True).start()

    def ping(self, name: str, timeout: float) -> None:
        """Ask a node anything; whatever it replies shows that its loop turns."""
        if self._session is None:
            return
        service = get_params(name)

        def on_reply(reply: zenoh.Reply) -> None:
            answered = reply.ok is not None or (
                reply.err is not None and str(reply.err.encoding) == wire.ERROR_ENCODING
            )
            if answered:
                self._post(lambda: self._on_answer(name))

        self._session.get(
            service.key(self._pinged),
            zenoh.handlers.Callback(on_reply, indirect=False),
            payload=wire.encode(GetParamsRequest([f"{name}.ping"])),
            encoding=wire.encoding(service.request),
            timeout=timeout,
        )

    def close(self) -> None:
        """Leave the bus."""
        if self._session is not None:
            self._session.close()

    def _connect(self) -> None:
        while self._session is None:
            try:
                session = open_client(self._address, wait=5.0)
            except Unreachable:
                continue
            self._tokens = session.liveliness().declare_subscriber(
                graph.node_key("*", "*"),
                zenoh.handlers.Callback(self._on_token, indirect=False),
                history=True,
            )
            self._session = session

    def _on_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        name, vehicle = graph.node_of(key), graph.vehicle_of(key)
        if name is None or vehicle not in self._vehicles:
            return
        seen = self._seen.setdefault(name, set())
        if sample.kind == zenoh.SampleKind.DELETE:
            seen.discard(vehicle)
            return
        seen.add(vehicle)
        if seen == self._vehicles:
            self._post(lambda: self._on_ready(name))
