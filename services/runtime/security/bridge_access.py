"""Addresses, certificates and keys of the bridges to other networks."""

import hashlib
import socket
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

from quadctl.services.runtime.errors import Invalid, UsageError

_KEY_BYTES = 32


class PeerAddress(NamedTuple):
    """Address that datagrams are sent to, or one of ours at which the peer `is_awaited`."""

    host: str
    port: int
    is_awaited: bool = False


def address_of(text: str) -> PeerAddress:
    """Return the address of e.g. udpout:127.0.0.1:14550; raise UsageError for anything else."""
    return _address(f"--to {text}", text, {"udpout"}, "udpout:127.0.0.1:14550")


def autopilot_address_of(text: str) -> PeerAddress:
    """Return the address of e.g. udpin:127.0.0.1:14540; raise UsageError for anything else."""
    return _address(f"--connect {text}", text, {"udpin", "udpout"}, "udpin:127.0.0.1:14540")


def _address(option: str, text: str, kinds: set[str], example: str) -> PeerAddress:
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in kinds or not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise UsageError(f"{option}: not an address", f"e.g. {example}")
    return PeerAddress(host.strip("[]"), int(port), is_awaited=kind == "udpin")


def check_peer(address: PeerAddress, text: str, *, signed: bool) -> None:
    """Raise UsageError for an unknown host, or one on the network without a signature.

    `text` is the option with its value.
    """
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)[0][4][0]
    except OSError as error:
        raise UsageError(f"{text}: {error.strerror}", "an IP address or a known host") from error
    if not signed and not ip_address(str(found).partition("%")[0]).is_loopback:
        raise UsageError(
            f"{text} is on the network, where anybody could fly the vehicle",
            "add --signing-key FILE, and give the other side the same key",
        )


def check_listener(host: str, *, encrypted: bool) -> None:
    """Raise UsageError for an address that is none, or one on the network without encryption."""
    try:
        address = ip_address(host)
    except ValueError as error:
        raise UsageError(
            f"--host {host}: not an IP address", "127.0.0.1, ::1 or 0.0.0.0"
        ) from error
    if not address.is_loopback and not encrypted:
        raise UsageError(
            f"--host {host} lets other machines watch, and their traffic is not encrypted",
            "add --cert FILE, or use a tunnel: ssh -L 8765:127.0.0.1:8765 HOST",
        )


def key_of(path: Path) -> bytes:
    """Return the key of a file: its 32 bytes, or if it is text, the SHA-256 of this passphrase.

    Raises Invalid for a file that cannot be read or is empty.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise Invalid(f"--signing-key {path}: {error.strerror}") from error
    phrase = data.strip()
    if len(data) == _KEY_BYTES and not (phrase.isascii() and phrase.decode("ascii").isprintable()):
        return data
    if not phrase:
        raise Invalid(f"--signing-key {path} is empty", "32 bytes, or a passphrase")
    # Ground stations make their key of a passphrase so, too.
    return hashlib.sha256(phrase).digest()
