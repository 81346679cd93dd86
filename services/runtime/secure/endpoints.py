"""Which endpoints are encrypted, and which must not be opened without it. Pure."""

from collections.abc import Iterable

from services.runtime.errors import UsageError

_SECURE = ("tls", "quic")
_ON_THIS_MACHINE = ("unixsock-stream",)
_LOOPBACK = ("127.", "localhost:", "[::1]:")


def is_secure(endpoint: str) -> bool:
    """Whether both ends show a certificate, and all between them is encrypted."""
    return endpoint.partition("/")[0] in _SECURE


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
        if protocol not in _ON_THIS_MACHINE and not place.startswith(_LOOPBACK):
            raise UsageError(
                f"{endpoint} is neither encrypted nor closed: whoever reaches it could fly",
                f"say tls/{place} with an identity (`quadctl keys --help`), or --insecure",
            )
