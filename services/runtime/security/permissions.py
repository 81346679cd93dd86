"""Rights of our certificate, and reasons for a failed handshake.

The hub enforces; this module explains. The Unix socket needs no certificate and allows everything.
"""

import socket
import ssl
import time
from collections.abc import Sequence

import zenoh

from quadctl.schemas import keyexpr
from quadctl.schemas.roles import Right, keys, may, node_may
from quadctl.schemas.topics import INFO
from quadctl.services.runtime.errors import (
    NotAllowed,
    QuadctlError,
    TimedOut,
    Unreachable,
    UsageError,
)
from quadctl.services.runtime.security.endpoints import how_to_open, is_secure
from quadctl.services.runtime.security.identity import Identity, Name, needed

_HINT = "`quadctl keys list`, on the machine with the fleet's keys, shows the valid certificates"
_WRONG_HOST = {62, 64}
"""OpenSSL's X509_V_ERR_HOSTNAME_MISMATCH and X509_V_ERR_IP_ADDRESS_MISMATCH."""


def why(endpoint: str, timeout: float) -> QuadctlError:
    """Return the reason why an attempt to connect has failed, within `timeout` (s)."""
    protocol, _, place = endpoint.partition("/")
    identity = needed(endpoint)
    silent = Unreachable(f"nothing answers at {endpoint}", how_to_open(endpoint))
    if protocol != "tls":
        # Python's ssl has no QUIC, and few have installed a library for it.
        return Unreachable(
            f"{endpoint} rejected {identity.name.common_name}, or nothing is there",
            "is the hub up? a tls endpoint would show which of the two it is",
        )
    host, _, port = place.rpartition(":")
    if host.startswith("["):
        return UsageError(
            f"{endpoint}: Zenoh connects by tls to no IPv6 address as such",
            "write a name of that address, e.g. one in /etc/hosts; the certificate needs it too",
        )
    try:
        return _shake(identity, host, int(port), timeout) or silent
    except TimeoutError:
        return TimedOut(f"{endpoint} did not answer within {timeout:g} s", silent.hint)
    except (OSError, ValueError):
        return silent


def _shake(identity: Identity, host: str, port: int, timeout: float) -> QuadctlError | None:
    tls = identity.tls()
    context = ssl.create_default_context(cafile=tls["root_ca_certificate"])
    context.load_cert_chain(tls["connect_certificate"], tls["connect_private_key"])
    # Before Python 3.11.4 a link that is cut would look like one that ends in due form.
    context.options &= ~getattr(ssl, "OP_IGNORE_UNEXPECTED_EOF", 0)  # OpenSSL 1.1 lacks it
    with socket.create_connection((host, port), timeout) as link:
        try:
            with context.wrap_socket(
                link, server_hostname=host, suppress_ragged_eofs=False
            ) as secured:
                # The hub verifies our certificate only after our side of the handshake is done, and
                # ends a valid one that is not on its list in due form, a little later.
                secured.settimeout(min(timeout, 2.0))
                if not secured.recv(1):
                    return kept_out(f"tls/{host}:{port}")
        except ssl.SSLCertVerificationError as problem:
            return _wrong_hub(identity, host, problem)
        except (ssl.SSLError, ConnectionResetError):
            return NotAllowed(
                f"the hub rejects the certificate {identity.name.common_name}",
                f"it has expired, or belongs to another fleet than the hub. {_HINT}",
            )
        except TimeoutError:
            return None
    return None


def _wrong_hub(who: Identity, host: str, problem: ssl.SSLCertVerificationError) -> QuadctlError:
    if problem.verify_code in _WRONG_HOST:
        return Unreachable(
            f"the hub's certificate is not valid for the address {host}",
            f"issue it again with --host {host}, or use an address that it is valid for",
        )
    return Unreachable(
        f"{host} answers, but is not a hub of our fleet: {problem.verify_message}",
        f"is {who.folder} the right identity?",
    )


IN_FORCE = 5.0
"""Seconds until a new list of names is in force, even on a busy machine; mostly 0.5 s."""
_POLL = 0.05
_LOOK = 0.5
"""Seconds within which a live vehicle answers."""
_TO: dict[Right, str] = {"listen": "listen to", "publish": "publish on", "see": "see"}


def allows(connect: str, right: Right, key: str) -> bool:
    """Return whether our role gives us the right to a key expression over that endpoint."""
    if not is_secure(connect):
        return True
    name = needed(connect).name
    return may(name.role, name.vehicles, right, key)


def check(connect: str, right: Right, *expressions: str) -> None:
    """Raise NotAllowed if our role lacks the right to a key expression over that endpoint."""
    for key in expressions:
        if not allows(connect, right, key):
            name = needed(connect).name
            article = "an" if name.role[0] in "aeiou" else "a"
            raise NotAllowed(
                f"not allowed: {article} {name.role} of {name.of} may not"
                f" {_TO.get(right, right)} {key} (your certificate {name.common_name})",
                _alternative(name, right),
            )


def check_node(node: str, right: Right, key: str) -> None:
    """Raise NotAllowed if a node with the rights of its name alone lacks one to a key."""
    if not node_may(node, right, key):
        raise NotAllowed(
            f"not allowed: {node} may not {_TO.get(right, right)} {key}",
            f"in this run it may offer what is {node}'s own, and read all else",
        )


def everything(connect: str) -> list[str]:
    """Return all keys that our role may listen to over that endpoint; none without roles."""
    if not is_secure(connect):
        return []
    name = needed(connect).name
    return keys(name.role, name.vehicles, "listen")


def is_let_in(session: zenoh.Session, timeout: float) -> bool:
    """Return whether our name is on the hub's list.

    The hub accepts every certificate of the fleet, but answers only the names on its list.
    """
    replies = session.liveliness().get(keyexpr.node_key("*", "gate"), timeout=timeout)
    return any(reply.ok is not None for reply in replies)


def welcome(session: zenoh.Session, connect: str, timeout: float) -> None:
    """Wait until the hub lets our traffic through; raises NotAllowed after `timeout` (s).

    For a session that reconnects by itself to a gate that reopens.
    """
    if not is_secure(connect):
        return
    deadline = time.monotonic() + min(timeout, IN_FORCE)
    while not is_let_in(session, timeout):
        if time.monotonic() > deadline:
            raise kept_out(connect)
        time.sleep(_POLL)


def kept_out(connect: str) -> NotAllowed:
    """Return the error for a hub that accepts our connection but none of our traffic."""
    return NotAllowed(
        f"not allowed: {connect} lets nothing through for {needed(connect).name.common_name}",
        "the certificate was revoked, the hub's list of names is old, or this name did too much in"
        " the last 10 s: `quadctl node logs gate` on that machine, or ask for a new certificate",
    )


def raise_if_blocked(
    session: zenoh.Session, connect: str, key: str, offers: Sequence[keyexpr.EndpointInfo]
) -> None:
    """Raise NotAllowed if a key without an answer is served: then the hub has blocked our query.

    Our certificate may grant more than the hub's list, which then may hide the endpoint as well;
    but every role may read the `info` of every vehicle.
    """
    if not is_secure(connect):
        return
    served = any(offer.key == key for offer in offers)
    if not offers:
        info = INFO.key(key.partition("/")[0])
        served = any(reply.ok for reply in session.get(info, timeout=_LOOK))
    if served:
        raise NotAllowed(
            f"not allowed: {connect} keeps {needed(connect).name.common_name} from {key}",
            "it is served: the hub's list of names grants less than your certificate, or its"
            " quadctl is another version",
        )


def _alternative(name: Name, right: Right) -> str:
    granted = keys(name.role, name.vehicles, right)
    if not granted:
        return "`quadctl keys issue operator` makes a certificate with this right"
    return f"it may {', '.join(granted[:6])}{' ..' if len(granted) > 6 else ''}"
