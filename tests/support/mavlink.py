"""Ground station of MAVLink on a socket of its own, and the bridge that it talks to."""

import socket
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import partial
from math import dist
from pathlib import Path
from typing import Any, Self

from pymavlink.dialects.v20 import common as mavlink

import quadctl
from quadctl.schemas.earth import Origin
from tests.support import bridges
from tests.support.running import DEADLINE

ORIGIN = Origin(47.397742, 8.545594, 488.0)
_AGAIN = 2.0
"""Seconds after which a request without an answer is sent again."""


class GroundStation:
    """Station 255 that keeps all messages; `system` is the one that it talks to."""

    def __init__(self, system: int = 1, key: bytes | None = None, port: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(0.1)
        self._is_closed = False
        self.port = self._socket.getsockname()[1]
        self.system, self.vehicle = system, (system, 1)
        self.messages: list[Any] = []
        self.bad = 0
        self._to: Any = None
        self._came = threading.Condition()
        self._codec = mavlink.MAVLink(None, 255, 190)
        self._codec.robust_parsing = True
        if key is not None:
            self._codec.signing.secret_key = key
            self._codec.signing.sign_outgoing = True
            self._codec.signing.timestamp = round((time.time() - 1_420_070_400) * 1e5)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closed = True
        self._reader.join()
        self._socket.close()

    def send(self, message: Any) -> None:
        """Send a message, once the bridge has sent one."""
        self.wait_for(lambda: self._to is not None)
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self._socket.sendto(data, self._to)

    def send_raw(self, data: bytes) -> None:
        """Send any bytes, once the bridge has sent a message."""
        self.wait_for(lambda: self._to is not None)
        self._socket.sendto(data, self._to)

    def packed(self, message: Any) -> bytes:
        """Return the packet of a message."""
        return bytes(message.pack(self._codec))

    def wait_for(self, condition: Callable[[], Any], timeout: float = DEADLINE) -> Any:
        """Return the condition's first true value."""
        ends = time.monotonic() + timeout
        with self._came:
            while not (found := condition()):
                if (left := ends - time.monotonic()) <= 0:
                    raise TimeoutError
                self._came.wait(left)
        return found

    def wait(
        self,
        type_: str,
        condition: Callable[[Any], Any] = bool,
        *,
        since: int | None = None,
        timeout: float = DEADLINE,
    ) -> Any:
        """Return the first message of a type that fulfils a condition, of those from now on."""
        seen = len(self.messages) if since is None else since

        def found() -> Any:
            nonlocal seen
            new, seen = self.messages[seen:], len(self.messages)
            for each in new:
                if (
                    each.get_type() == type_
                    and each.get_srcSystem() == self.system
                    and condition(each)
                ):
                    return each
            return None

        return self.wait_for(found, timeout)

    def ask(self, message: Any, type_: str, condition: Callable[[Any], Any] = bool) -> Any:
        """Send a message, and return the first answer of a type that fulfils a condition.

        Datagrams may be lost, so it is sent again, as ground stations do.
        """
        since, ends = len(self.messages), time.monotonic() + DEADLINE
        while True:
            self.send(message)
            with suppress(TimeoutError):
                return self.wait(type_, condition, since=since, timeout=_AGAIN)
            assert time.monotonic() < ends, f"no answer to {message}"

    def command(self, command: int, *params: float) -> int:
        """Execute a command, NaN for the parameters that are not given; return its result."""
        filled = (*params, *(float("nan"),) * (7 - len(params)))
        message = mavlink.MAVLink_command_long_message(*self.vehicle, command, 0, *filled)
        result: int = self.ask(message, "COMMAND_ACK", lambda ack: ack.command == command).result
        return result

    def goto(self, x: float, y: float, z: float) -> int:
        """Send the vehicle to a point, m, ENU, as QGroundControl does; return the result."""
        latitude, longitude = ORIGIN.to_earth(x, y)
        message = mavlink.MAVLink_command_int_message(
            *self.vehicle, mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_REPOSITION, 0, 0,
            -1, 1, 0, float("nan"), latitude, longitude, ORIGIN.altitude + z,
        )  # fmt: skip
        result: int = self.ask(
            message, "COMMAND_ACK", lambda ack: ack.command == mavlink.MAV_CMD_DO_REPOSITION
        ).result
        return result

    def text(self, part: str, *, since: int) -> str:
        """Return the first text with a part, put together from its messages."""
        found: str = self.wait_for(
            lambda: next((t for t in self.texts(since=since) if part in t), None)
        )
        return found

    def texts(self, *, since: int = 0) -> list[str]:
        """Return the texts since a message's number."""
        found: dict[int, str] = {}
        single: list[str] = []
        for each in self.messages[since:]:
            if each.get_type() == "STATUSTEXT" and each.get_srcSystem() == self.system:
                if each.id:
                    found[each.id] = found.get(each.id, "") + each.text
                else:
                    single.append(each.text)
        return [*single, *found.values()]

    def upload(self, kind: int, items: list[Any]) -> int:
        """Upload a plan, given as functions of target and number; return the result."""
        since = len(self.messages)
        self.send(mavlink.MAVLink_mission_count_message(*self.vehicle, len(items), kind))
        while True:
            # By its place: equal messages of an earlier upload may be in the list.
            since, asked = self.wait_for(partial(self._asked, kind, since))
            if asked.get_type() == "MISSION_ACK":
                result: int = asked.type
                return result
            self.send(items[asked.seq](asked.seq))

    def _asked(self, kind: int, since: int) -> tuple[int, Any] | None:
        """Return the next request or result of an upload, after the place that follows it."""
        for place, each in enumerate(self.messages[since:], since + 1):
            if (
                each.get_type() in {"MISSION_REQUEST_INT", "MISSION_ACK"}
                and each.get_srcSystem() == self.system
                and each.mission_type == kind
            ):
                return place, each
        return None

    def download(self, kind: int) -> list[Any]:
        """Return the items of a plan."""
        count = self.ask(
            mavlink.MAVLink_mission_request_list_message(*self.vehicle, kind),
            "MISSION_COUNT",
            lambda m: m.mission_type == kind,
        ).count
        items = [
            self.ask(
                mavlink.MAVLink_mission_request_int_message(*self.vehicle, number, kind),
                "MISSION_ITEM_INT",
                partial(_is_number, number),
            )
            for number in range(count)
        ]
        self.send(mavlink.MAVLink_mission_ack_message(*self.vehicle, 0, kind))
        return items

    def item(
        self, command: int, params: tuple[float, ...], place: tuple[float, float], z: float,
        *, kind: int = 0, frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    ) -> Callable[[int], Any]:  # fmt: skip
        """Return a function that makes an item of its number; the place is m, ENU."""
        x, y = ORIGIN.to_earth(*place)
        filled = (*params, *(0.0,) * (4 - len(params)))
        return lambda number: mavlink.MAVLink_mission_item_int_message(
            *self.vehicle, number, frame, command, number == 0, 1, *filled, x, y, z, kind
        )

    def _read(self) -> None:
        while not self._is_closed:
            try:
                data, address = self._socket.recvfrom(65_536)
            except TimeoutError:
                continue
            except ConnectionError:  # the bridge has gone
                continue
            with self._came:
                self._to = address
                for message in self._codec.parse_buffer(data) or ():
                    if message.get_type() == "BAD_DATA":
                        self.bad += 1
                    else:
                        self.messages.append(message)
                self._came.notify_all()


def _is_number(number: int, item: Any) -> bool:
    return bool(item.seq == number)


def bridge(realm: str, port: int, *more: str) -> AbstractContextManager[subprocess.Popen[bytes]]:
    """Bridge a run to a port of this machine, see bridges.bridge."""
    return bridges.bridge(realm, "mavlink", "--to", f"udpout:127.0.0.1:{port}", *more)


def key_file(folder: Path, phrase: str) -> Path:
    """Write a passphrase to a file."""
    file = folder / "signing.key"
    file.write_text(f"{phrase}\n")
    return file


def near(run: quadctl.Run, place: tuple[float, float, float]) -> bool:
    """Return whether the vehicle hovers at a place, m, ENU."""
    p, state = run.vehicle.pose().position, run.vehicle.state()
    return dist((p.x, p.y, p.z), place) < 0.1 and state.state == "HOVERING"
