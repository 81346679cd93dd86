"""Why a hub over TLS does not let us in: the handshake made once more, by a library that says why."""

import socket
import ssl

from services.runtime.errors import NotAllowed, QuadctlError, TimedOut, Unreachable
from services.runtime.secure.endpoints import how_to_open
from services.runtime.secure.identity import CERTIFICATE, FLEET, KEY, Identity, needed

_ASK = "`quadctl keys list`, where the fleet's keys are, shows whose certificates are good"
_WRONG_NAME = 62
"""X509_V_ERR_HOSTNAME_MISMATCH; 64 is the same of an address."""
_WRONG_ADDRESS = 64


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
    if problem.verify_code in {_WRONG_NAME, _WRONG_ADDRESS}:
        return Unreachable(
            f"the hub's certificate is not made out to {host}",
            f"issue it anew with --host {host}, or say an address that it is made out to",
        )
    return Unreachable(
        f"what answers at {host} is no hub of our fleet: {problem.verify_message}",
        f"is {who.folder} the right identity?",
    )
