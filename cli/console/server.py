"""The web server, on a thread of its own: Ctrl-C ends the process at once, whoever is connected."""

import socket
import threading

import uvicorn
from fastapi import FastAPI, Request
from nicegui import ui

from cli.console.guard import Guard, may_control
from cli.console.link import Link
from cli.console.page import Page
from cli.options import Options
from services.runtime import vehicles
from services.runtime.errors import QuadctlError


class _Links:
    """A link for each vehicle that somebody has looked at."""

    def __init__(self, options: Options, first: str) -> None:
        self._options, self._first = options, first
        self._links = {first: Link(options, first)}

    def vehicles(self) -> list[str]:
        """What there is to choose from; without asking a bus, which may be slow."""
        options = self._options
        there = [] if options.connect else vehicles.of(options.realm, "", options.timeout)
        return sorted({*there, *self._links})

    def of(self, vehicle: str) -> Link:
        """The link of a vehicle; of the first, for one that there is not."""
        if vehicle not in self._links and vehicle in self.vehicles():
            self._links[vehicle] = Link(self._options, vehicle)
        return self._links.get(vehicle, self._links[self._first])


def serve(
    options: Options, first: str, listening: socket.socket, token: str, *, beyond: bool
) -> None:
    """Serve pages until the process ends; raises where the server does."""
    links = _Links(options, first)

    @ui.page("/")
    async def page(request: Request) -> None:
        asked = request.query_params
        control = may_control(token, asked.get("token", ""))
        shown = Page(links.of(asked.get("vehicle", "")), links.vehicles(), control=control)
        shown.build()
        await ui.context.client.connected()
        await shown.feed()

    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    ui.run_with(
        outer,
        title="quadctl console",
        language="en-US",
        tailwind=False,
        show_welcome_message=False,
        binding_refresh_interval=None,
        message_history_length=20,
        gzip_middleware_factory=None,  # a page is of this machine, where packing takes longer
    )
    config = uvicorn.Config(
        Guard(outer, beyond=beyond), log_level="error", access_log=False, server_header=False
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
