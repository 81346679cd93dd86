"""The bus connection of the console: one per vehicle, restored after each loss."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from quadctl.cli.console.model import TICK, Board
from quadctl.cli.context import Options
from quadctl.parameters import RunningParams
from quadctl.schemas.messages import Position
from quadctl.schemas.topics import POSE, PRESSURE, REQUEST, STATE, ZONES
from quadctl.services.runtime import run_files
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.bus.streams import QueuedSubscriber
from quadctl.services.runtime.errors import Invalid, NotAllowed, QuadctlError, Unreachable
from quadctl.services.runtime.realm import Realm

T = TypeVar("T")

_AGAIN = 0.5  # s between two attempts to reach a run that is gone
_LOOK = 1.0  # s between two looks at the nodes; the parameters are read half as often
_BACKLOG = 100
_MANY = 5000  # states of other vehicles that wait for a look
_GONE = 3.0  # s without a state of another vehicle after which it is not shown
_log = logging.getLogger(__name__)


class Link:
    """Thread that keeps a board up to date for as long as the process lives."""

    def __init__(self, options: Options, vehicle: str) -> None:
        self.vehicle, self._options = vehicle, options
        self._lock = threading.Lock()
        self._board = Board(vehicle)
        self._client: Client | None = None
        threading.Thread(target=self._run, name=f"link {vehicle}", daemon=True).start()

    def see(self, look: Callable[[Board], T]) -> T:
        """Return the result of `look` on the board, under its lock."""
        with self._lock:
            return look(self._board)

    @property
    def realm(self) -> Realm | None:
        """Return the realm of a run on this machine, else None (no access to its folder)."""
        return None if self._options.connect else Realm(self._options.realm)

    @property
    def client(self) -> Client:
        """Return the connection for a call; raise Unreachable while there is none."""
        if (client := self._client) is None:
            raise Unreachable(
                f"not connected: {self._board.problem or 'connecting'}",
                "the console reconnects by itself",
            )
        return client

    def read_parameters(self) -> None:
        """Read the parameters of all nodes now; raise if a node does not answer."""
        results = RunningParams(self.client).every()
        with self._lock:
            for values in results.answers.values():
                self._board.values |= values
        results.fail()

    def _run(self) -> None:
        while True:
            try:
                options = self._options
                with Client(
                    options.realm, self.vehicle, connect=options.connect, timeout=options.timeout
                ) as client:
                    self._listen(client)
            except Exception as problem:  # noqa: BLE001 - the page shows it; the next attempt may do
                self._client = None
                if not isinstance(problem, QuadctlError):
                    _log.exception("the connection of the console has failed")
                nodes = self._processes()
                with self._lock:
                    self._board.problem, self._board.nodes = str(problem), nodes
            time.sleep(_AGAIN)

    def _listen(self, client: Client) -> None:
        """Follow the vehicle; raise once the hub is gone."""
        poses = client.subscribe(POSE, backlog=1)
        readings = client.subscribe(PRESSURE, backlog=1)
        states = client.subscribe(STATE, backlog=_BACKLOG)
        requests = client.subscribe(REQUEST, backlog=1)
        fences = client.subscribe(ZONES, backlog=1, held=True)
        others = _Others(client, self.vehicle)
        looked, self._client = 0.0, client
        with self._lock:
            self._board.problem = ""
            # Safety may be another one now, which has no zones and publishes none.
            self._board.update_zones(())
        threading.Thread(target=self._poll_parameters, args=(client,), daemon=True).start()
        while True:
            began = time.monotonic()
            if began - looked >= _LOOK:
                looked = began
                client.nodes()
                nodes, places = self._processes(), others.places()
                with self._lock:
                    self._board.nodes = nodes
                    self._board.update_others(places)
            pose, reading, waypoint = poses.next(0), readings.next(0), requests.next(0)
            changes, zones = list(iter(lambda: states.next(0), None)), fences.next(0)
            with self._lock:
                if waypoint is not None:
                    self._board.add_request(Position(waypoint.x, waypoint.y, waypoint.z))
                if zones is not None:
                    self._board.update_zones(zones.zones)
                for state in changes:
                    self._board.update_state(state)
                self._board.tick(pose, reading)
            time.sleep(max(0.0, began + TICK - time.monotonic()))

    def _poll_parameters(self, client: Client) -> None:
        """Read the parameters repeatedly: other clients change them too."""
        while self._client is client:
            # The table of processes shows a node that does not answer; its old values stay.
            with contextlib.suppress(QuadctlError):
                self.read_parameters()
            time.sleep(2 * _LOOK)

    def _processes(self) -> list[run_files.ProcessRecord]:
        if self.realm is None:
            return []
        try:
            return run_files.read(self.realm).nodes
        except QuadctlError:
            return []


class _Others:
    """Goals of the run's other vehicles, each of which publishes its state once a second."""

    def __init__(self, client: Client, vehicle: str) -> None:
        self._own = STATE.key(vehicle)
        self._goals: dict[str, tuple[float, Position]] = {}
        """By the key of a state: when it came (monotonic s), and its goal, m."""
        self._states: QueuedSubscriber | None = None
        # A role may permit one vehicle alone.
        with contextlib.suppress(NotAllowed):
            self._states = client.listen(STATE.key("*"), backlog=_MANY)

    def places(self) -> tuple[Position, ...]:
        """Return where each holds or flies to, m; not those that fell silent."""
        now, states = time.monotonic(), self._states
        # Those that wait now: a flood must not hold up the page.
        waiting = (states.next(0) for _ in range(states.waiting)) if states else ()
        for message in filter(None, waiting):
            if message.key != self._own:
                # What cannot be read is another author's: the page shows the others.
                with contextlib.suppress(Invalid):
                    self._goals[message.key] = now, message.decoded(STATE.type).goal
        self._goals = {key: one for key, one in self._goals.items() if now - one[0] < _GONE}
        return tuple(goal for _, goal in self._goals.values())
