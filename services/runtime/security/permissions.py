"""Rights of our certificate, and reasons of a failed handshake.

The hub enforces; this module explains. Without a certificate, on the Unix socket, all is allowed.
"""

import socket
import ssl
import time
from collections.abc import Sequence

import zenoh

from quadctl.schemas import keyexpr
from quadctl.schemas.roles import Right, keys, may
from quadctl.schemas.topics import INFO
from quadctl.services.runtime.errors import NotAllowed, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.security.endpoints import how_to_open, is_secure
from quadctl.services.runtime.security.identity import (
    CERTIFICATE,
    FLEET,
    KEY,
    Identity,
    Name,
    needed,
)

_ASK = "`quadctl keys list`, where the fleet's keys are, shows whose certificates are good"
_WRONG_HOST = {62, 64}
"""X509_V_ERR_HOSTNAME_MISMATCH, and the same of an address."""


def why(endpoint: str, timeout: float) -> QuadctlError:
    """What keeps us out, after an attempt to connect that has failed; takes up to `timeout` s."""
    protocol, _, place = endpoint.partition("/")
    who = needed(endpoint)
    nobody = Unreachable(f"nothing answers at {endpoint}", how_to_open(endpoint))
    if protocol != "tls":
        # There is no asking twice: to say why takes a library that few have.
        return Unreachable(
            f"{endpoint} did not let in {who.name.common_name}, or nothing is there",
            "is the hub up? over tls it would be told which",
        )
    host, _, port = place.rpartition(":")
    try:
        return _shake(who, host.strip("[]"), int(port), timeout) or nobody
    except TimeoutError:
        return TimedOut(f"{endpoint} did not answer within {timeout:g} s", nobody.hint)
    except (OSError, ValueError):
        return nobody


def _shake(who: Identity, host: str, port: int, timeout: float) -> QuadctlError | None:
    context = ssl.create_default_context(cafile=who.path(FLEET))
    context.load_cert_chain(who.path(CERTIFICATE), who.path(KEY))
    with socket.create_connection((host, port), timeout) as link:
        try:
            with context.wrap_socket(link, server_hostname=host) as secured:
                # The hub's opinion of our certificate comes after its own part is done.
                secured.settimeout(min(timeout, 0.5))
                secured.recv(1)
        except ssl.SSLCertVerificationError as problem:
            return _not_ours(who, host, problem)
        except (ssl.SSLError, ConnectionResetError):
            return NotAllowed(
                f"the hub does not take the certificate {who.name.common_name}",
                f"it has expired, or is of another fleet than the hub's. {_ASK}",
            )
        except TimeoutError:
            return None
    return None


def _not_ours(who: Identity, host: str, problem: ssl.SSLCertVerificationError) -> QuadctlError:
    if problem.verify_code in _WRONG_HOST:
        return Unreachable(
            f"the hub's certificate is not made out to {host}",
            f"issue it anew with --host {host}, or say an address that it is made out to",
        )
    return Unreachable(
        f"what answers at {host} is no hub of our fleet: {problem.verify_message}",
        f"is {who.folder} the right identity?",
    )


IN_FORCE = 5.0
"""Seconds in which a new list of names is in force however busy the machine; mostly it is half of one."""
_POLL = 0.05
_LOOK = 0.5
"""Seconds in which a vehicle that is there has said so."""
_TO: dict[Right, str] = {"listen": "listen to", "publish": "publish on", "see": "see"}


def allows(connect: str, right: Right, key: str) -> bool:
    """Whether our role over that endpoint extends to a key or expression."""
    if not is_secure(connect):
        return True
    who = needed(connect).name
    return may(who.role, who.vehicles, right, key)


def check(connect: str, right: Right, *asked: str) -> None:
    """Raise NotAllowed where our role over that endpoint does not extend to a key or expression."""
    for key in asked:
        if not allows(connect, right, key):
            who = needed(connect).name
            article = "an" if who.role[0] in "aeiou" else "a"
            raise NotAllowed(
                f"not allowed: {article} {who.role} of {who.of} may not {_TO.get(right, right)} {key}"
                f" (your certificate {who.common_name})",
                _instead(who, right),
            )


def everything(connect: str) -> list[str]:
    """All that our role over that endpoint may listen to; nothing where there are no roles."""
    if not is_secure(connect):
        return []
    who = needed(connect).name
    return keys(who.role, who.vehicles, "listen")


def is_let_in(session: zenoh.Session, timeout: float) -> bool:
    """Whether the hub lets anything of ours through.

    It lets in whoever has a certificate of the fleet, but tells only those on its list who it is.
    """
    replies = session.liveliness().get(keyexpr.node_key("*", "gate"), timeout=timeout)
    return any(reply.ok is not None for reply in replies)


def welcome(session: zenoh.Session, connect: str, timeout: float) -> None:
    """Raise NotAllowed where the hub at that endpoint lets nothing of ours through in time (s).

    For a session that comes back by itself to a gate that opens anew.
    """
    if not is_secure(connect):
        return
    deadline = time.monotonic() + min(timeout, IN_FORCE)
    while not is_let_in(session, timeout):
        if time.monotonic() > deadline:
            raise kept_out(connect)
        time.sleep(_POLL)


def kept_out(connect: str) -> NotAllowed:
    """What is known of a hub that lets nothing of ours through."""
    return NotAllowed(
        f"not allowed: {connect} lets nothing through for {needed(connect).name.common_name}",
        "the certificate was revoked, or the hub has an old list of names: have one issued",
    )


def tell_apart(
    session: zenoh.Session, connect: str, key: str, offers: Sequence[keyexpr.EndpointInfo]
) -> None:
    """Raise NotAllowed where a key is served that nobody answered: the hub has kept us from it.

    Our certificate may say more than the hub's list. What that denies we may not even see, but `info`
    of every vehicle may be read by all.
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
            "it is served: the hub's list of names says less than your certificate, or its quadctl is"
            " another version",
        )


def _instead(who: Name, right: Right) -> str:
    granted = keys(who.role, who.vehicles, right)
    if not granted:
        return "`quadctl keys issue operator` would make a certificate that may"
    return f"it may {', '.join(granted[:6])}{' ..' if len(granted) > 6 else ''}"
