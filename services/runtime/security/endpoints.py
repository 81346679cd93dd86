"""Endpoints: their form, the encrypted ones, and those that must not be opened in plain. Pure."""

import re
from collections.abc import Iterable

from quadctl.schemas.params import LOCAL, PORTS, SECURE
from quadctl.services.runtime.errors import UsageError

_FORM = rf"(?:{'|'.join(PORTS)})/[^/?#]+:\d{{1,5}}(?:[?#].*)?|(?:{'|'.join(LOCAL)})/.+"
_LOOPBACK = ("127.", "localhost:", "[::1]:")


def check(endpoint: str) -> None:
    """Raise UsageError for what is none."""
    if not re.fullmatch(_FORM, endpoint):
        raise UsageError(
            f"'{endpoint}' is no endpoint",
            f"endpoints are PROTOCOL/ADDRESS, as tls/lab2:7447; the protocols are {', '.join(PORTS)},"
            f" each with HOST:PORT, and {', '.join(LOCAL)} with a path",
        )


def how_to_open(endpoint: str) -> str:
    """What to do where nothing answers at it, for it may be another machine's."""
    protocol, _, place = endpoint.partition("/")
    if protocol in LOCAL:
        return "does a hub run that has this socket? is the path right?"
    port = re.split("[?#]", place)[0].rpartition(":")[2]
    return (
        f"on that machine: `quadctl up --listen {protocol}/0.0.0.0:{port}`; is the address right?"
    )


def is_secure(endpoint: str) -> bool:
    """Whether both ends show a certificate, and all between them is encrypted."""
    return endpoint.partition("/")[0] in SECURE


def secure(endpoints: Iterable[str]) -> list[str]:
    """Those that are the gate's."""
    return [endpoint for endpoint in endpoints if is_secure(endpoint)]


def plain(endpoints: Iterable[str]) -> list[str]:
    """Those that are the hub's own."""
    return [endpoint for endpoint in endpoints if not is_secure(endpoint)]


def refuse_open(endpoints: Iterable[str]) -> None:
    """Raise UsageError for a plain endpoint that reaches beyond this machine."""
    for endpoint in plain(endpoints):
        protocol, _, place = endpoint.partition("/")
        if protocol not in LOCAL and not place.startswith(_LOOPBACK):
            raise UsageError(
                f"{endpoint} is neither encrypted nor closed: whoever reaches it could fly",
                f"say tls/{place} with an identity (`quadctl keys --help`), or --insecure",
            )
