"""Link: datagrams of MAVLink to and from one address, signed if there is a key."""

import hashlib
import hmac
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from quadctl.services.bridges.base import Log
from quadctl.services.bridges.options import PeerAddress

_MOST_BYTES = 65_536
_SINCE = 1_420_070_400
"""1 January 2015 as Unix time (s), from which signatures count time, in units of 10 us."""
_TICK = 0.02
_CLOCKS_DIFFER = 60.0
"""Seconds that a signer's clock may differ from ours; MAVLink bounds the past only, but one clock that is
ahead would lock out all the others."""
_FORGOTTEN = 2.0
"""Seconds of silence after which an awaited peer may come from another address."""


class MavlinkLink:
    """Socket that sends to one address, and takes the answers from there.

    If the peer is awaited, its address is that of the first valid packet.
    """

    def __init__(self, peer: PeerAddress, key: bytes | None, log: Log) -> None:
        """Open the socket; raise OSError for an unknown host, or a port that is taken.

        Without a route to the peer it is tried again with each message.
        """
        self._log = log
        family, kind, proto, _, address = socket.getaddrinfo(
            peer.host, peer.port, type=socket.SOCK_DGRAM
        )[0]
        self._socket = socket.socket(family, kind, proto)
        self._seen, self._is_awaited = 0.0, peer.is_awaited
        self._peer: Any = None if peer.is_awaited else address
        self._is_joined = peer.is_awaited
        if peer.is_awaited:
            self._socket.bind(address)
        elif not self._join():
            log.warning("there is no route to %s yet: it is tried again", peer.host)
        self._key, self._lock = key, threading.Lock()
        self._codecs: dict[tuple[int, int], Any] = {}
        self._parser = self._codec(0, 0)

    def _join(self) -> bool:
        """Let the system drop what another program or machine sends; return whether there is a route."""
        with suppress(OSError):
            self._socket.connect(self._peer)
            self._is_joined = True
        return self._is_joined

    def _codec(self, system: int, component: int) -> Any:
        codec = _Codec(system, component, self._log)
        if self._key is not None:
            codec.signing.secret_key = self._key
            codec.signing.timestamp = _now()
            codec.signing.sign_outgoing = True
        return codec

    def sender(
        self, system: int, component: int = mavlink.MAV_COMP_ID_AUTOPILOT1
    ) -> Callable[[Any], None]:
        """Return a function that sends messages of a system's component; from any thread."""
        name = system, component
        codec = self._codecs.setdefault(name, self._codec(*name))

        def send(message: Any) -> None:
            with self._lock:
                if self._peer is None or not (self._is_joined or self._join()):
                    return
                if self._key is not None:
                    # A ground station refuses time that is a minute behind its own.
                    signing, seen = codec.signing, self._parser.signing.timestamp
                    signing.timestamp = max(signing.timestamp, seen, _now())
                try:
                    data = message.pack(codec)
                except struct.error:
                    self._log.exception("not sent: %s", message)
                    return
                codec.seq = (codec.seq + 1) % 256
                try:
                    if self._is_awaited:
                        self._socket.sendto(data, self._peer)
                    else:
                        self._socket.send(data)
                except OSError:
                    # Nobody listens there now: a ground station may come later.
                    return

        return send

    def start(
        self,
        handle: Callable[[Any], None],
        tick: Callable[[], None],
        post: Callable[[Callable[[], None]], None],
    ) -> None:
        """Receive on a thread of its own; raise a fault of it on the loop that runs what is posted.

        A process that receives nothing any more has to end, so that it is started anew.
        """

        def run() -> None:
            try:
                self.receive(handle, tick)
            except BaseException as fault:
                post(partial(_fail, fault))
                raise

        threading.Thread(target=run, daemon=True).start()

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
                data, address = self._socket.recvfrom(_MOST_BYTES)
            except OSError:  # nothing has come, or nobody listens there now
                continue
            if not self._is_from_peer(address):
                continue
            if self._key is not None:
                # A packet that is older than a minute is a repeated one.
                signing = self._parser.signing
                signing.timestamp = max(signing.timestamp, _now())
            for message in self._parser.parse_datagram(data):
                # A message of an unknown number is returned without any check.
                if not message.get_type().startswith(("BAD_DATA", "UNKNOWN_")):
                    if self._is_awaited:
                        self._peer, self._seen = address, time.monotonic()
                    handle(message)

    def _is_from_peer(self, address: Any) -> bool:
        if not self._is_awaited or self._peer in {None, address}:
            return True
        return time.monotonic() - self._seen > _FORGOTTEN


class _Codec(mavlink.MAVLink):  # type: ignore[misc]
    """Codec of one system, without two faults of pymavlink 2.4.50."""

    def __init__(self, system: int, component: int, log: Log) -> None:
        super().__init__(None, system, component)
        self._log, self._complained = log, set[int]()

    def parse_datagram(self, data: bytes) -> list[Any]:
        """Return the messages of a datagram; a bad one is BAD_DATA."""
        self.robust_parsing = True
        # The stream's parser would take the next packet for the rest of a bad one.
        self.buf, self.buf_index = bytearray(), 0
        self.expected_length = mavlink.HEADER_LEN_V1 + 2
        return self.parse_buffer(data) or []

    def check_signature(self, packet: bytearray, system: int, component: int) -> bool:
        """Return whether a packet has our signature, of about now, and is no repetition."""
        # The base class stores the time of a packet with a wrong signature, too: a forged one
        # from the future would lock the sender out.
        key = self.signing.secret_key
        expected = hashlib.sha256(key + bytes(packet[:-6])).digest()[:6]
        if not hmac.compare_digest(expected, packet[-6:]):
            return False
        ahead = (int.from_bytes(packet[-12:-6], "little") - _now()) / 1e5
        if ahead <= _CLOCKS_DIFFER and super().check_signature(packet, system, component):
            return True
        if abs(ahead) > _CLOCKS_DIFFER and system not in self._complained:
            self._complained.add(system)
            self._log.warning(
                "system %d signs with a clock that is %.0f s %s ours: its packets are dropped; set the clocks",
                system, abs(ahead), "ahead of" if ahead > 0 else "behind",
            )  # fmt: skip
        return False


def _fail(fault: BaseException) -> None:
    raise fault


def _now() -> int:
    """Return the time of signatures."""
    return round((time.time() - _SINCE) * 1e5)
