"""Link: datagrams of MAVLink to and from ground stations, signed if there is a key."""

import hashlib
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from quadctl.services.runtime.errors import Invalid, UsageError

_MOST_BYTES = 65_536
_SINCE = 1_420_070_400
"""1 January 2015 as Unix time (s), from which signatures count time, in units of 10 us."""
_TICK = 0.02


def address_of(text: str) -> tuple[str, int]:
    """Return host and port of e.g. udpout:127.0.0.1:14550; raise UsageError for anything else."""
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind != "udpout" or not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise UsageError(f"--to {text}: not an address", "e.g. udpout:127.0.0.1:14550")
    return host, int(port)


def key_of(path: Path) -> bytes:
    """Return the key of a file: its 32 bytes, or the SHA-256 of the passphrase in it, as ground stations do."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise Invalid(f"--signing-key {path}: {error.strerror}") from error
    if len(data) == 32:
        return data
    phrase = data.strip()
    if not phrase:
        raise Invalid(f"--signing-key {path} is empty", "32 bytes, or a passphrase")
    return hashlib.sha256(phrase).digest()


class Link:
    """Socket that sends to one address, and takes what comes from that machine."""

    def __init__(self, to: tuple[str, int], key: bytes | None) -> None:
        """Open the socket; raise OSError for an unknown host."""
        family, kind, proto, _, address = socket.getaddrinfo(*to, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, proto)
        # No packet of another machine is taken.
        self._socket.connect(address)
        self._key, self._lock = key, threading.Lock()
        self._codecs: dict[int, Any] = {}
        self._parser = self._codec(0)

    def _codec(self, system: int) -> Any:
        codec = mavlink.MAVLink(None, system, mavlink.MAV_COMP_ID_AUTOPILOT1)
        codec.robust_parsing = True
        if self._key is not None:
            codec.signing.secret_key = self._key
            codec.signing.link_id = 0
            codec.signing.timestamp = round((time.time() - _SINCE) * 1e5)
            codec.signing.sign_outgoing = True
            codec.signing.allow_unsigned_callback = None
        return codec

    def sender(self, system: int) -> Callable[[Any], None]:
        """Return a function that sends messages of a system; from any thread."""
        codec = self._codecs.setdefault(system, self._codec(system))

        def send(message: Any) -> None:
            with self._lock:
                data = message.pack(codec)
                codec.seq = (codec.seq + 1) % 256
                try:
                    self._socket.send(data)
                except OSError:
                    # Nobody listens there now: a ground station may come later.
                    return

        return send

    def receive(self, handle: Callable[[Any], None], tick: Callable[[], None]) -> None:
        """Call `handle` with each valid message, and `tick` fifty times a second; for ever."""
        due = time.monotonic()
        while True:
            left = due - time.monotonic()
            if left <= 0:
                tick()
                due = max(due + _TICK, time.monotonic())
                continue
            self._socket.settimeout(left)
            try:
                data = self._socket.recv(_MOST_BYTES)
            except TimeoutError:
                continue
            except OSError:  # nobody listens there now
                continue
            for message in self._parser.parse_buffer(data) or ():
                if message.get_type() != "BAD_DATA":
                    handle(message)
