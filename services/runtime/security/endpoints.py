"""Endpoints: syntax check, encrypted and plain ones, refusal of open ones. Pure."""

from collections.abc import Iterable

from quadctl.schemas.protocols import LOCAL, PORTS, SECURE
from quadctl.services.runtime.errors import UsageError

_FORM = rf"(?:{'|'.join(PORTS)})/[^/?#]+:\d{{1,5}}(?:[?#].*)?|(?:{'|'.join(LOCAL)})/.+"
_LOOPBACK = ("127.", "localhost:", "[::1]:")


def check(endpoint: str) -> None:
    """Raise UsageError if the text is not an endpoint."""
    import re  # takes 6 ms, and a realm's own endpoint needs no check

    if not re.fullmatch(_FORM, endpoint):
        raise UsageError(
            f"'{endpoint}' is not an endpoint",
            f"write PROTOCOL/ADDRESS, e.g. tls/lab2:7447; the protocols are {', '.join(PORTS)},"
            f" each with HOST:PORT, and {', '.join(LOCAL)} with a path",
        )


def how_to_open(endpoint: str) -> str:
    """Return a hint for an endpoint that does not answer; it may be on another machine."""
    protocol, _, place = endpoint.partition("/")
    if protocol in LOCAL:
        return "does a hub with this socket run? is the path right?"
    port = place.partition("?")[0].partition("#")[0].rpartition(":")[2]
    opens = f"quadctl up --listen {protocol}/0.0.0.0:{port}"
    return f"on that machine: `{opens}`; is the address right?"


def url_host(host: str) -> str:
    """Return a host as it stands in a URL: an IPv6 address in brackets."""
    return f"[{host}]" if ":" in host else host


def is_secure(endpoint: str) -> bool:
    """Return whether both ends show a certificate and the traffic is encrypted."""
    return endpoint.partition("/")[0] in SECURE


def secure(endpoints: Iterable[str]) -> list[str]:
    """Return the endpoints that the gate opens."""
    return [endpoint for endpoint in endpoints if is_secure(endpoint)]


def plain(endpoints: Iterable[str]) -> list[str]:
    """Return the endpoints that the hub itself opens."""
    return [endpoint for endpoint in endpoints if not is_secure(endpoint)]


def refuse_open(endpoints: Iterable[str]) -> None:
    """Raise UsageError for a plain endpoint that reaches beyond this machine."""
    for endpoint in plain(endpoints):
        protocol, _, place = endpoint.partition("/")
        if protocol not in LOCAL and not place.startswith(_LOOPBACK):
            raise UsageError(
                f"{endpoint} is neither encrypted nor local: anyone on the network could fly",
                f"use tls/{place} with an identity (`quadctl keys --help`), or --insecure",
            )
