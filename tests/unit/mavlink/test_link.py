"""Sockets of a link: who is taken for the peer."""

import logging
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from quadctl.services.bridges.mavlink.link import MavlinkLink
from quadctl.services.bridges.options import AutopilotOptions, MavlinkOptions
from tests.support.autopilot import free_udp_port
from tests.support.running import eventually

KEY = bytes(range(32))


@contextmanager
def linked(key: bytes | None = None) -> Iterator[tuple[MavlinkLink, int, list[Any]]]:
    """A link that awaits its peer, its port, and what it takes."""
    port, taken = free_udp_port(), list[Any]()
    address = AutopilotOptions(f"udpin:127.0.0.1:{port}").peer
    link = MavlinkLink(address, key, logging.getLogger("link"))
    threading.Thread(target=link.receive, args=(taken.append, lambda: None), daemon=True).start()
    yield link, port, taken


def sender() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(0.2)
    return made


def heartbeat(key: bytes | None = None, system: int = 1, ahead: float = 0.0) -> bytes:
    """Return a packet of a system; with a key, signed by a clock that is some seconds ahead."""
    codec = mavlink.MAVLink(None, system, 1)
    if key is not None:
        codec.signing.secret_key, codec.signing.sign_outgoing = key, True
        codec.signing.timestamp = round((time.time() + ahead - 1_420_070_400) * 1e5)
    return bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(codec))


def unknown() -> bytes:
    """Return a packet of a number that the dialect has not, without a valid checksum."""
    return struct.pack("<BBBBBBB", 0xFD, 1, 0, 0, 0, 1, 1) + (54_321).to_bytes(3, "little") + b"abc"


def hears(by: socket.socket, say: Callable[[], None]) -> bool:
    say()
    try:
        by.recv(1000)
    except TimeoutError:
        return False
    return True


class Unrouted(socket.socket):
    """Socket whose first two connections find no route."""

    left = 2

    def connect(self, address: Any) -> None:
        if Unrouted.left:
            Unrouted.left -= 1
            raise OSError(101, "Network is unreachable")
        super().connect(address)


def test_a_peer_without_a_route_is_tried_again_with_each_message(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    with sender() as station:
        host, port = station.getsockname()
        monkeypatch.setattr(socket, "socket", Unrouted)
        link = MavlinkLink(
            MavlinkOptions(f"udpout:{host}:{port}").peer, None, logging.getLogger("link")
        )
        monkeypatch.undo()
        assert "there is no route to 127.0.0.1 yet" in caplog.text
        send = link.sender(1)

        def beat() -> None:
            send(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))

        assert [hears(station, beat) for _ in range(3)] == [False, True, True]
        link._socket.close()


def test_the_first_valid_packet_names_the_peer_and_no_other_is_heard():
    with linked() as (link, port, taken), sender() as theirs, sender() as other:
        send = link.sender(245, 191)

        def say() -> None:
            send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))

        for packet in (b"", b"noise", unknown()):
            other.sendto(packet, ("127.0.0.1", port))
        assert not hears(other, say)
        theirs.sendto(heartbeat(), ("127.0.0.1", port))
        eventually(lambda: len(taken) == 1)
        other.sendto(heartbeat(), ("127.0.0.1", port))
        assert hears(theirs, say)
        assert not hears(other, say)
        assert len(taken) == 1


def test_with_a_key_only_a_signed_packet_names_the_peer():
    with linked(KEY) as (link, port, taken), sender() as theirs, sender() as other:
        send = link.sender(245, 191)
        for packet in (heartbeat(), unknown(), heartbeat(bytes(32))):
            other.sendto(packet, ("127.0.0.1", port))
        assert not hears(other, lambda: send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)))
        theirs.sendto(heartbeat(KEY), ("127.0.0.1", port))
        eventually(lambda: len(taken) == 1)
        assert hears(theirs, lambda: send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)))


def test_a_signer_whose_clock_is_wrong_is_named_once_and_locks_nobody_out(
    caplog: pytest.LogCaptureFixture,
):
    with linked(KEY) as (_, port, taken), sender() as station:
        for ahead in (3600, 3601, -3600, 1e7, 61):
            station.sendto(heartbeat(KEY, 7 if ahead > 0 else 8, ahead), ("127.0.0.1", port))
        for system, ahead in ((1, 30.0), (2, -30.0), (3, 0.0)):
            station.sendto(heartbeat(KEY, system, ahead), ("127.0.0.1", port))
        eventually(lambda: len(taken) == 3)
        assert [message.get_srcSystem() for message in taken] == [1, 2, 3]
    fast, slow = [line for line in caplog.messages if "set the clocks" in line]
    assert "system 7 signs with a clock that is 3600 s ahead of ours" in fast
    assert "system 8 signs with a clock that is 3600 s behind ours" in slow
