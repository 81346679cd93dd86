"""`console`: start-up errors, and the clients that its server accepts."""

import asyncio
import html
import http.client
import json
import re
import signal
import socket
import sys
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, closing
from urllib.parse import urlsplit

import pytest
import socketio  # type: ignore[import-untyped] # its stubs are skipped in pyproject.toml
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from quadctl.services.runtime import procfs
from tests.support.command_line import Quadctl, runner
from tests.support.lab import Lab, private_lab
from tests.support.running import DEADLINE, eventually
from tests.support.served_console import Console, served

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


@pytest.fixture(scope="module")
def two_vehicles() -> Iterator[Lab]:
    """System with two vehicles."""
    with private_lab() as made:
        made.start("--vehicles", 2, "--set", "dynamics.start.z=1")  # no take-off under way
        yield made


@pytest.fixture(scope="module")
def console_of_two(two_vehicles: Lab) -> Iterator[Console]:
    with served(two_vehicles) as made:
        yield made


def get(url: str, **headers: str) -> tuple[int, str, http.client.HTTPMessage]:
    parts = urlsplit(url)
    # On a busy machine fifty pages take long to draw.
    with closing(http.client.HTTPConnection(parts.netloc, timeout=120)) as connection:
        connection.request("GET", f"{parts.path}?{parts.query}", headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode(), answer.headers


_WATCHED = """
import gc, sys, threading
every = gc.get_objects
def get_objects(*of):
    names = [thread.name for thread in threading.enumerate()]
    print("objects are listed beside", *names, file=sys.stderr, flush=True)
    return every(*of)
gc.get_objects = get_objects
from quadctl.cli.main import main
main()
"""


@pytest.mark.thorough
def test_no_link_of_the_console_runs_while_nicegui_lists_all_objects(two_vehicles: Lab):
    # In Python 3.11 a tuple that another thread is making then fails with a SystemError.
    _, *words = two_vehicles.command("console", "--port", "0", "--json")
    words = words[words.index("console") :]
    process = two_vehicles.spawn(sys.executable, "-c", _WATCHED, *words)
    assert eventually(lambda: "objects are listed beside" in process.log)
    process.send(signal.SIGINT)
    assert process.wait() == 130, process.log
    assert "link" not in process.log, process.log


@pytest.mark.thorough
def test_console_without_a_run_exits_3(lab: Lab):
    done = lab.quadctl("console", "--port", "0", "--json")
    assert (done.code, done.out) == (3, "")
    assert "nothing is running" in done.error["message"]


def test_console_without_its_extra_names_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    quadctl: Quadctl = runner(monkeypatch, capsys)
    said = quadctl("console", "--json")
    assert (said.code, said.out) == (1, "")
    assert "pip install 'quadctl[console]'" in said.error["hint"]


def test_console_refuses_a_public_address_without_insecure(lab: Lab):
    done = lab.quadctl("console", "--host", "0.0.0.0", "--json")
    assert done.code == 2
    assert "--insecure" in done.error["hint"]
    assert "not encrypted" in done.error["message"]
    assert lab.quadctl("console", "--host", "here").code == 2


def test_console_refuses_an_unknown_vehicle(two_vehicles: Lab):
    done = two_vehicles.quadctl("console", "--vehicle", "uav7", "--port", "0", "--json")
    assert done.code == 3
    assert "uav0, uav1" in done.error["hint"]


@pytest.mark.thorough
def test_console_exits_7_when_its_port_is_in_use(two_vehicles: Lab, console_of_two: Console):
    port = urlsplit(console_of_two.watch).port
    assert two_vehicles.quadctl("console", "--port", port).code == 7


def test_each_vehicle_has_a_page(console_of_two: Console):
    for number, vehicle in enumerate(("uav0", "uav1")):
        status, page, _ = get(f"{console_of_two.control}&vehicle={vehicle}")
        assert status == 200
        chosen = f'"model-value":{{"value":{number},"label":"{vehicle}"}}'
        assert chosen in page.replace(" ", "")


def test_a_watching_page_does_not_contain_the_token(console_of_two: Console):
    token = urlsplit(console_of_two.control).query.partition("=")[2]
    status, page, headers = get(console_of_two.watch)
    assert status == 200
    assert token not in page
    assert "watching only" in page
    assert "watching only" in get(f"{console_of_two.watch}?token={token[:-1]}")[1]
    assert "default-src 'self'" in headers["content-security-policy"]


def test_a_foreign_host_header_is_refused(console_of_two: Console):
    status, said, _ = get(console_of_two.control, Host="evil.example")
    assert status == 403
    assert "127.0.0.1" in said


@pytest.mark.thorough
def test_a_page_of_another_site_is_refused(console_of_two: Console):
    assert get(console_of_two.control, Origin="http://evil.example")[0] == 403
    embedded = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "image"}
    assert get(console_of_two.watch, **embedded)[0] == 403
    assert get(console_of_two.watch, Host="[::1")[0] == 403
    address = f"ws://{urlsplit(console_of_two.watch).netloc}{SOCKET}"
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(address, origin=Origin("http://evil.example")),
    ):
        pass
    assert refused.value.response.status_code == 403
    own = f"http://{urlsplit(console_of_two.watch).netloc}"
    with connect(address, origin=Origin(own)) as taken:
        assert taken.recv(timeout=DEADLINE)


MOST = 40
"""Pages without the token that a console serves at a time."""


def asked(console: Console) -> socket.socket:
    """Ask for a page, and do not read it."""
    parts = urlsplit(console.watch)
    made = socket.create_connection((parts.hostname or "", parts.port or 0), timeout=20)
    made.sendall(f"GET / HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())
    return made


def test_pages_that_do_not_read_are_limited_and_end_with_it(two_vehicles: Lab):
    with served(two_vehicles) as console, ExitStack() as held:
        get(console.watch)
        for _ in range(MOST):
            held.enter_context(asked(console))
        eventually(lambda: get(console.watch)[0] == 503)
        assert get(console.watch)[:2] == (
            503,
            "40 pages are open already: close some, wait a minute\n",
        )
        assert get(console.control)[0] == 200
        memory = memory_of(console)
        for _ in range(50):  # fewer than come in the minute after which a page is given up
            assert get(console.watch)[0] == 503
        grown = (memory_of(console) - memory) / 1e6
        console.process.send(signal.SIGTERM)
        assert console.process.wait() == -signal.SIGTERM
    # 50 more pages would be 37 MB.
    assert grown < 10.0


def memory_of(console: Console) -> int:
    """Return the console's resident memory, bytes."""
    return procfs.stats_of(console.process.pid).rss or 0


MALFORMED: tuple[object, ...] = (
    {}, None, [1], "x", {"client_id": []}, {"client_id": "?", "id": 0, "level": "evil", "message": "\x1b[31m"},
)  # fmt: skip
ARGUMENTS: tuple[object, ...] = (
    [], ["{}"], ["null"], ["true"], ["1e999"], ["[" * 3000], 5,
    ['{"x": 4, "y": 4, "z": 1, "button": 0, "hits": []}'],
)  # fmt: skip


def test_a_watching_socket_controls_nothing_and_breaks_nothing(
    two_vehicles: Lab, console_of_two: Console
):
    page = get(console_of_two.watch)[1]
    listeners, client = page_listeners(page), re.search(r"'client_id': '([^']+)'", page)
    assert len(listeners) > 20
    assert client is not None
    with two_vehicles.bare() as bare:
        before, params = bare.query("uav0/safety/state", b"").value, parameters(two_vehicles)
        events: list[tuple[str, object]] = [
            ("event", {"id": number, "client_id": client[1], "listener_id": name, "args": args})
            for number, name in listeners
            for args in ARGUMENTS
        ]
        names = ("event", "javascript_response", "ack", "log", "handshake")
        events += [(name, message) for name in names for message in MALFORMED]
        asyncio.run(send_events(console_of_two.watch, client[1], events))
        after = bare.query("uav0/safety/state", b"").value
    changed = {name for name in before if before[name] != after[name]} - {"stamp", "nearest"}
    assert (changed, parameters(two_vehicles)) == (set(), params)
    assert get(console_of_two.watch)[0] == 200
    log = console_of_two.process.log
    assert log.count("malformed event") == 1
    assert "Traceback" not in log
    assert "\x1b" not in log


def parameters(lab: Lab) -> str:
    return lab.quadctl("param", "list", "--vehicle", "uav0").out


def page_listeners(page: str) -> list[tuple[int, str]]:
    """Return the element and the name of each listener on a page."""
    found = re.search(r"parseElements\(String.raw`(.*?)`\)", page, re.DOTALL)
    assert found is not None
    elements = json.loads(html.unescape(found[1]))
    return [
        (int(number), event["listener_id"])
        for number, element in elements.items()
        for event in element.get("events", [])
    ]


async def send_events(watch: str, client: str, events: list[tuple[str, object]]) -> None:
    """Open a page's socket as a browser does, send events, and wait until they are handled."""
    socket = socketio.AsyncClient(reconnection=False)
    base = watch.rstrip("/")
    query = f"client_id={client}&next_message_id=0&implicit_handshake=true"
    await socket.connect(
        f"{base}?{query}&tab_id={uuid.uuid4()}&document_id={uuid.uuid4()}",
        headers={"Origin": base},
        socketio_path="/_nicegui_ws/socket.io",
        transports=["websocket"],
    )
    for name, message in events:
        await socket.emit(name, message)
    answered = asyncio.Event()
    # The server handles a client's events in order: it answers this one last.
    await socket.emit("event", {"client_id": "?"}, callback=lambda *_: answered.set())
    await asyncio.wait_for(answered.wait(), DEADLINE)
    await socket.disconnect()
