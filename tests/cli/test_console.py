"""`console`: start-up errors, and the clients that its server accepts."""

import http.client
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from quadctl.services.runtime import procfs
from tests.support.command_line import Quadctl, runner
from tests.support.lab import Lab, private_lab
from tests.support.running import eventually
from tests.support.served_console import Console, served

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


@pytest.fixture(scope="module")
def two_vehicles() -> Iterator[Lab]:
    """System with two vehicles."""
    with private_lab() as made:
        made.start("--vehicles", 2)
        yield made


@pytest.fixture(scope="module")
def console_of_two(two_vehicles: Lab) -> Iterator[Console]:
    with served(two_vehicles) as made:
        yield made


def get(url: str, **headers: str) -> tuple[int, str, http.client.HTTPMessage]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.netloc, timeout=20)
    connection.request("GET", f"{parts.path}?{parts.query}", headers=headers)
    answer = connection.getresponse()
    found = answer.status, answer.read().decode(), answer.headers
    connection.close()
    return found


def test_console_without_a_run_exits_3(lab: Lab):
    done = lab.quadctl("console", "--port", "0", "--json")
    assert (done.code, done.out) == (3, "")
    assert "nothing is running" in done.error["message"]


def test_console_without_its_extra_names_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    quadctl: Quadctl = runner(monkeypatch, capsys)
    said = quadctl("console", "--json")
    assert (said.code, said.out) == (1, "")
    assert "pip install '.[console]'" in said.error["hint"]


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


def test_a_page_of_another_site_is_refused(console_of_two: Console):
    assert get(console_of_two.control, Origin="http://evil.example")[0] == 403
    address = f"ws://{urlsplit(console_of_two.watch).netloc}{SOCKET}"
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(address, origin=Origin("http://evil.example")),
    ):
        pass
    assert refused.value.response.status_code == 403
    own = f"http://{urlsplit(console_of_two.watch).netloc}"
    with connect(address, origin=Origin(own)) as taken:
        assert taken.recv(timeout=10)


MOST = 50
"""Pages that a console serves at a time."""


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
            "50 pages are open already: close some, wait a minute\n",
        )
        memory = memory_of(console)
        for _ in range(200):
            assert get(console.watch)[0] == 503
        grown = (memory_of(console) - memory) / 1e6
        console.process.send(signal.SIGTERM)
        assert console.process.wait() == -signal.SIGTERM
    # 200 more pages would be 150 MB.
    assert grown < 10.0


def memory_of(console: Console) -> int:
    """Return the console's resident memory, bytes."""
    return procfs.stats_of(console.process.pid).rss or 0
