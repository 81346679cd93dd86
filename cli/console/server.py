"""The web server of the console on its thread, and the guard that refuses foreign requests."""

import asyncio
import ipaddress
import logging
import secrets
import socket
import threading
import traceback
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from typing import Any
from urllib.parse import parse_qs, urlsplit

import uvicorn
from fastapi import FastAPI, Request
from nicegui import Client, app, core, ui

from quadctl.cli import output
from quadctl.cli.console.bus_link import Link
from quadctl.cli.console.page import Page
from quadctl.cli.context import Options
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.vehicles import vehicles_of

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_HEADERS = (
    # The browser itself blocks any traffic of the page with other addresses.
    (
        b"content-security-policy",
        b"default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; frame-ancestors 'none'",
    ),
    (b"referrer-policy", b"no-referrer"),  # the address holds the token
    (b"x-content-type-options", b"nosniff"),
)


_MOST_PAGES = 50
"""Pages, of nearly a megabyte each. NiceGUI keeps one that no browser connects to for a minute."""
_MOST_WATCHING = 40
"""Pages without the token, so that those who only watch cannot take the last place of the owner's."""


def refusal_reason(headers: Mapping[bytes, str], *, beyond: bool) -> str:
    """Return the reason to refuse a request with these headers, empty to serve it.

    DNS rebinding shows as a foreign host name, another site's page as a foreign origin, or as the
    site that embeds ours, e.g. as an image. `beyond`: other machines may send requests.
    """
    host, origin = headers.get(b"host", ""), headers.get(b"origin", "")
    try:
        name, site = urlsplit(f"//{host}").hostname or "", urlsplit(origin).netloc
    except ValueError:
        return "the Host or the Origin is malformed: open the console as 127.0.0.1"
    if not _is_ours(name, beyond=beyond):
        return f"{host or 'no host'} is not the console's name: open it as 127.0.0.1"
    if origin and site != host:
        return f"pages of {origin} may not use the console"
    # A link in a mail or in a page may open the console: a browser then asks for a document.
    foreign = headers.get(b"sec-fetch-site", "") in {"cross-site", "same-site"}
    if foreign and headers.get(b"sec-fetch-dest", "") != "document":
        return "pages of other sites may not embed the console"
    return ""


def may_control(token: str, given: str) -> bool:
    """Return whether the given token is right, in the same time for right and wrong ones."""
    return secrets.compare_digest(token.encode(), given.encode())


def _is_ours(name: str, *, beyond: bool) -> bool:
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return name == "localhost" or (beyond and name == socket.gethostname().lower())
    # An address cannot be rebound by DNS.
    return beyond or address.is_loopback


class Guard:
    """ASGI layer in front of the app: refuses foreign requests, and pages beyond the most.

    It adds the security headers.
    """

    def __init__(self, app: App, token: str, *, beyond: bool) -> None:
        self._app, self._token, self._beyond = app, token, beyond

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or websocket; see ASGI."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
        status, reason = 403, refusal_reason(headers, beyond=self._beyond)
        if not reason and scope["path"] == "/" and (most := self._most_for(scope)):
            status, reason = 503, f"{most} pages are open already: close some, wait a minute"
        if not reason:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": reason[:100]})
        else:
            head = [(b"content-type", b"text/plain; charset=utf-8")]
            await send({"type": "http.response.start", "status": status, "headers": head})
            await send({"type": "http.response.body", "body": f"{reason}\n".encode()})

    def _most_for(self, scope: Scope) -> int:
        """Return the most pages, if so many are open that this one is refused, else 0."""
        query = parse_qs(scope["query_string"].decode("latin-1"))
        given = query.get("token", [""])[0]
        most = _MOST_PAGES if may_control(self._token, given) else _MOST_WATCHING
        return most if len(Client.instances) >= most else 0


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *_HEADERS]
        await send(message)

    return sending


class _Malformed(logging.Filter):
    """Filter of NiceGUI's errors about events that no page of ours sends: one line, once.

    Anybody who watches can send such events; each would print a traceback.
    """

    def __init__(self) -> None:
        super().__init__()
        self._seen = False

    def install(self) -> None:
        """Take over the running loop's errors and those of NiceGUI's log."""
        logging.getLogger("nicegui").addFilter(self)
        asyncio.get_running_loop().set_exception_handler(self._unretrieved)

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether an error is to be logged: it was raised outside of NiceGUI."""
        error = record.exc_info[1] if record.exc_info else None
        if error is None or "nicegui" not in traceback.extract_tb(error.__traceback__)[-1].filename:
            return True
        self._report(error)
        return False

    def _unretrieved(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        # The reader of sockets has no other errors than those of the messages.
        if "AsyncServer._handle_event_internal" in repr(context.get("future")):
            self._report(context["exception"])
        else:
            loop.default_exception_handler(context)

    def _report(self, error: BaseException) -> None:
        if not self._seen:
            self._seen = True
            output.note(f"a page sent a malformed event, which is ignored: {repr(error)[:100]}")


class _Links:
    """Link of each vehicle whose page was opened."""

    def __init__(self, options: Options, first: str) -> None:
        self._options, self._first = options, first
        self._links: dict[str, Link] = {}

    def begin(self) -> None:
        """Make the link of the first vehicle, once the server has started.

        Before, NiceGUI looks for its server among all objects of the process, and in Python 3.11 a
        tuple that another thread is just making cannot be finished then.
        """
        self._links[self._first] = Link(self._options, self._first)

    def vehicles(self) -> list[str]:
        """Return the vehicles to choose from, without a query on a bus, which may be slow."""
        options = self._options
        known = [] if options.connect else vehicles_of(options.realm, "", options.timeout)
        return sorted({*known, *self._links})

    def of(self, vehicle: str) -> Link:
        """Return the link of a vehicle, the first vehicle's for an unknown name."""
        if vehicle not in self._links and vehicle in self.vehicles():
            self._links[vehicle] = Link(self._options, vehicle)
        return self._links.get(vehicle, self._links[self._first])


def serve(
    options: Options, first: str, listening: socket.socket, token: str, *, beyond: bool
) -> None:
    """Serve pages until the process ends; raise if the server fails."""
    links = _Links(options, first)

    @ui.page("/")
    async def page(request: Request) -> None:
        query = request.query_params
        control = may_control(token, query.get("token", ""))
        shown = Page(links.of(query.get("vehicle", "")), links.vehicles(), control=control)
        shown.build()
        await ui.context.client.connected()
        await shown.feed()

    # A page's text would reach the terminal, with any control characters.
    core.sio.on("log", lambda *_: None)
    app.on_startup(_Malformed().install)
    app.on_startup(links.begin)
    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    ui.run_with(
        outer,
        title="quadctl console",
        language="en-US",
        tailwind=False,
        show_welcome_message=False,
        binding_refresh_interval=None,
        message_history_length=20,
        gzip_middleware_factory=None,  # on one machine packing takes longer than sending
    )
    config = uvicorn.Config(
        Guard(outer, token, beyond=beyond), log_level="error", access_log=False, server_header=False
    )
    failed: list[BaseException] = []
    ended = threading.Event()

    def run() -> None:
        try:
            uvicorn.Server(config).run(sockets=[listening])
        except BaseException as error:  # noqa: BLE001 - raised again on the main thread
            failed.append(error)
        finally:
            ended.set()

    threading.Thread(target=run, name="web", daemon=True).start()
    ended.wait()
    raise QuadctlError("the console's web server ended") from (failed[0] if failed else None)
