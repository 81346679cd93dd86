"""Options of the bridges: their commands check them and pass them on, their processes use them.

What they stand for is computed here; a wrong option raises UsageError, Invalid or QuadctlError there, and
`check` computes all of it.
"""

import hashlib
import os
import secrets
import socket
import ssl
from ipaddress import ip_address
from pathlib import Path
from typing import ClassVar, NamedTuple

from msgspec import Struct

from quadctl.schemas.earth import Origin, origin_of
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.services.runtime.security.endpoints import check as check_endpoint

TOKEN = "QUADCTL_FOXGLOVE_TOKEN"  # noqa: S105 - the name of a variable
_DOMAIN = "ROS_DOMAIN_ID"
_KEY_BYTES = 32
_MOST_PORT = 65_535
_MOST_DOMAIN = 232
"""Largest domain of ROS, whose ports end there."""
_SHORTEST_TOKEN = 8
"""Characters of a token that nobody guesses."""


class FoxgloveOptions(Struct, frozen=True):
    """Options of the bridge to Foxglove; its token is in the environment, where no other user reads it."""

    port: int = 8765
    host: str = "127.0.0.1"
    cert: str = ""
    key: str = ""
    origins: tuple[str, ...] = ()

    @property
    def token(self) -> str:
        """Return the token with which clients may act; empty if none may."""
        token = os.environ.get(TOKEN, "")
        if 0 < len(token) < _SHORTEST_TOKEN:
            raise UsageError(f"{TOKEN} is too short", f"at least {_SHORTEST_TOKEN} characters")
        return token

    @property
    def tls(self) -> ssl.SSLContext | None:
        """Return the certificate to serve with, if there is one."""
        if self.key and not self.cert:
            raise UsageError("--key without --cert", "add --cert FILE")
        if not self.cert:
            return None
        tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            tls.load_cert_chain(self.cert, self.key or None)
        except OSError as error:  # SSLError, too
            raise Invalid(
                f"--cert {self.cert}: {error.strerror or error}", "a PEM certificate, and its key"
            ) from error
        return tls

    def bound(self) -> socket.socket:
        """Return a new socket that has the port."""
        if not 0 < self.port <= _MOST_PORT:
            raise UsageError(f"--port {self.port}: there is no such port", f"1 to {_MOST_PORT}")
        try:
            is_loopback = ip_address(self.host).is_loopback
        except ValueError as error:
            hint = "127.0.0.1, ::1 or 0.0.0.0"
            raise UsageError(f"--host {self.host}: not an IP address", hint) from error
        if not (is_loopback or self.cert):
            raise UsageError(
                f"--host {self.host} lets other machines watch, and their traffic is not encrypted",
                "add --cert FILE, or use a tunnel: ssh -L 8765:127.0.0.1:8765 HOST",
            )
        made = socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET)
        if os.name == "posix":  # a port whose last connections have just ended is free
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            made.bind((self.host, self.port))
        except OSError as error:
            made.close()
            other = self.port + 1 if self.port < _MOST_PORT else FoxgloveOptions().port
            raise QuadctlError(
                f"port {self.port} cannot be opened: {error.strerror}",
                f"end the program that has it, or choose another: --port {other}",
            ) from error
        return made

    def check(self) -> None:
        """Raise the error of the first wrong option."""
        _ = self.token, self.tls
        self.bound().close()


class Ros2Options(Struct, frozen=True):
    """Options of the bridge to ROS 2."""

    router: str = "tcp/127.0.0.1:7447"
    domain: int | None = None

    @property
    def number(self) -> int:
        """Return the domain, else that of the environment, like every program of ROS."""
        text = str(self.domain) if self.domain is not None else os.environ.get(_DOMAIN) or "0"
        if not text.isdecimal() or int(text) > _MOST_DOMAIN:
            what = f"--domain {text}" if self.domain is not None else f"{_DOMAIN}={text}"
            raise UsageError(f"{what}: there is no such domain", f"0 to {_MOST_DOMAIN}")
        return int(text)

    def check(self) -> None:
        """Raise the error of the first wrong option."""
        _ = self.number
        check_endpoint(self.router)


class PeerAddress(NamedTuple):
    """Address that datagrams are sent to, or one of ours at which the peer `is_awaited`."""

    host: str
    port: int
    is_awaited: bool = False


class MavlinkOptions(Struct, frozen=True):
    """Options of the bridge to MAVLink."""

    OPTION: ClassVar[str] = "--to"
    KINDS: ClassVar[tuple[str, ...]] = ("udpout",)

    address: str = "udpout:127.0.0.1:14550"
    origin: tuple[float, ...] = ()
    signing_key: str = ""

    @property
    def given(self) -> str:
        """Return the option of the address with its value."""
        return f"{self.OPTION} {self.address}"

    @property
    def peer(self) -> PeerAddress:
        """Return the address, one on the network only with a key."""
        kind, _, rest = self.address.partition(":")
        host, _, port = rest.rpartition(":")
        right = port.isdecimal() and 0 < int(port) <= _MOST_PORT
        if kind not in self.KINDS or not host or not right:
            example = type(self)().address
            raise UsageError(f"{self.given}: not an address", f"e.g. {example}")
        try:
            found = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_DGRAM)[0][4][0]
        except OSError as error:
            hint = "an IP address or a known host"
            raise UsageError(f"{self.given}: {error.strerror}", hint) from error
        if not self.signing_key and not ip_address(str(found).partition("%")[0]).is_loopback:
            raise UsageError(
                f"{self.given} is on the network, where anybody could fly the vehicle",
                "add --signing-key FILE, and give the other side the same key",
            )
        return PeerAddress(host.strip("[]"), int(port), is_awaited=kind == "udpin")

    @property
    def place(self) -> Origin:
        """Return the place of our origin."""
        try:
            return origin_of(self.origin)
        except ValueError as error:
            raise UsageError(
                f"--origin: {error}", "-89 to 89 degrees, -180 to 180 degrees, -1000 to 10 000 m"
            ) from error

    @property
    def secret(self) -> bytes | None:
        """Return the key of the file: its 32 bytes, or if it is text, the SHA-256 of this passphrase."""
        if not self.signing_key:
            return None
        try:
            data = Path(self.signing_key).read_bytes()
        except OSError as error:
            raise Invalid(f"--signing-key {self.signing_key}: {error.strerror}") from error
        phrase = data.strip()
        is_text = phrase.isascii() and phrase.decode("ascii").isprintable()
        if len(data) == _KEY_BYTES and not is_text:
            return data
        if not phrase:
            raise Invalid(f"--signing-key {self.signing_key} is empty", "32 bytes, or a passphrase")
        # Ground stations make their key of a passphrase so, too.
        return hashlib.sha256(phrase).digest()

    def check(self) -> None:
        """Raise the error of the first wrong option."""
        _ = self.place, self.peer, self.secret


class AutopilotOptions(MavlinkOptions, frozen=True):
    """Options of the process that stands for an autopilot; without `fenced` it gets no fence."""

    OPTION: ClassVar[str] = "--connect"
    KINDS: ClassVar[tuple[str, ...]] = ("udpin", "udpout")

    address: str = "udpin:127.0.0.1:14540"
    fenced: bool = True

    @property
    def place(self) -> Origin:
        """Return the place of our origin, which has no default."""
        if not self.origin:
            raise UsageError(
                "--origin is missing: where is the cage's centre on the ground?",
                "--origin LAT LON ALT, in degrees and m above mean sea level",
            )
        return super().place


BridgeOptions = FoxgloveOptions | Ros2Options | MavlinkOptions


def set_token(*, control: bool) -> str:
    """Put a token into the environment, that which it has or a new one, none without `control`."""
    token = (os.environ.get(TOKEN) or secrets.token_urlsafe(16)) if control else ""
    os.environ[TOKEN] = token
    return token
