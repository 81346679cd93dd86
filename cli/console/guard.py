"""Who may talk to the page's server: this machine's browsers, from the page itself."""

import ipaddress
import secrets
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import urlsplit

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_HEADERS = (
    # The browser itself holds it that nothing is loaded from, or sent to, anywhere else.
    (
        b"content-security-policy",
        b"default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; frame-ancestors 'none'",
    ),
    (b"referrer-policy", b"no-referrer"),  # the address holds the token
    (b"x-content-type-options", b"nosniff"),
)


def why_refused(host: str, origin: str, *, beyond: bool) -> str:
    """Why a request with these headers is not served; empty where it is.

    A name that a stranger's DNS points here (rebinding) is no name of ours, and another site's
    page has an origin that is not ours. `beyond`: other machines may ask.
    """
    name = urlsplit(f"//{host}").hostname or ""
    if not _is_ours(name, beyond=beyond):
        return f"{host or 'nobody'} is not the console's name: open it by 127.0.0.1"
    if origin and urlsplit(origin).netloc != host:
        return f"pages of {origin} may not talk to the console"
    return ""


def may_control(token: str, given: str) -> bool:
    """Whether the token given is the one; takes as long for a wrong one as for the right one."""
    return secrets.compare_digest(token.encode(), given.encode())


def _is_ours(name: str, *, beyond: bool) -> bool:
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return name == "localhost" or (beyond and name == socket.gethostname().lower())
    # An address cannot be rebound: whoever writes it means this machine.
    return beyond or address.is_loopback


class Guard:
    """Refuses them before anything else sees them; and tells browsers what the page may do."""

    def __init__(self, app: App, *, beyond: bool) -> None:
        self._app, self._beyond = app, beyond

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or websocket; see ASGI."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get(b"host", ""), headers.get(b"origin", "")
        why = why_refused(host, origin, beyond=self._beyond)
        if not why:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": why[:100]})
        else:
            head = [(b"content-type", b"text/plain; charset=utf-8")]
            await send({"type": "http.response.start", "status": 403, "headers": head})
            await send({"type": "http.response.body", "body": f"{why}\n".encode()})


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *_HEADERS]
        await send(message)

    return sending
