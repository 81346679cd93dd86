"""The command: how it begins and ends, and whom its server talks to."""

import http.client
import sys
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.support.command_line import Quadctl, runner
from tests.support.lab import Lab, private_lab
from tests.support.served_console import Console, served

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


@pytest.fixture(scope="module")
def pair() -> Iterator[Lab]:
    """Two vehicles."""
    with private_lab() as made:
        made.start("--vehicles", 2)
        yield made


@pytest.fixture(scope="module")
def pairs_console(pair: Lab) -> Iterator[Console]:
    with served(pair) as made:
        yield made


def get(url: str, **headers: str) -> tuple[int, str, http.client.HTTPMessage]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.netloc, timeout=20)
    connection.request("GET", f"{parts.path}?{parts.query}", headers=headers)
    answer = connection.getresponse()
    found = answer.status, answer.read().decode(), answer.headers
    connection.close()
    return found


def test_nothing_running_is_told_at_the_start(lab: Lab):
    done = lab.quadctl("console", "--port", "0", "--json")
    assert (done.code, done.out) == (3, "")
    assert "nothing is running" in done.error["message"]


def test_without_the_extra_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    quadctl: Quadctl = runner(monkeypatch, capsys)
    said = quadctl("console", "--json")
    assert (said.code, said.out) == (1, "")
    assert "pip install 'quadctl[console]'" in said.error["hint"]


def test_it_does_not_listen_beyond_this_machine_unasked(lab: Lab):
    done = lab.quadctl("console", "--host", "0.0.0.0", "--json")
    assert done.code == 2
    assert "--insecure" in done.error["hint"]
    assert "not encrypted" in done.error["message"]
    assert lab.quadctl("console", "--host", "here").code == 2


def test_a_vehicle_that_there_is_not_is_told_at_the_start(pair: Lab):
    done = pair.quadctl("console", "--vehicle", "uav7", "--port", "0", "--json")
    assert done.code == 3
    assert "uav0, uav1" in done.error["hint"]


def test_a_taken_port_is_told(pair: Lab, pairs_console: Console):
    port = urlsplit(pairs_console.watch).port
    assert pair.quadctl("console", "--port", port).code == 7


def test_each_vehicle_has_a_page(pairs_console: Console):
    for number, vehicle in enumerate(("uav0", "uav1")):
        status, page, _ = get(f"{pairs_console.control}&vehicle={vehicle}")
        assert status == 200
        chosen = f'"model-value":{{"value":{number},"label":"{vehicle}"}}'
        assert chosen in page.replace(" ", "")


def test_the_token_is_on_no_page_that_watches(pairs_console: Console):
    token = urlsplit(pairs_console.control).query.partition("=")[2]
    status, page, headers = get(pairs_console.watch)
    assert status == 200
    assert token not in page
    assert "watching only" in page
    assert "watching only" in get(f"{pairs_console.watch}?token={token[:-1]}")[1]
    assert "default-src 'self'" in headers["content-security-policy"]


def test_another_name_for_this_machine_is_refused(pairs_console: Console):
    status, said, _ = get(pairs_console.control, Host="evil.example")
    assert status == 403
    assert "127.0.0.1" in said


def test_another_sites_page_gets_nothing(pairs_console: Console):
    assert get(pairs_console.control, Origin="http://evil.example")[0] == 403
    address = f"ws://{urlsplit(pairs_console.watch).netloc}{SOCKET}"
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(address, origin=Origin("http://evil.example")),
    ):
        pass
    assert refused.value.response.status_code == 403
    own = f"http://{urlsplit(pairs_console.watch).netloc}"
    with connect(address, origin=Origin(own)) as taken:
        assert taken.recv(timeout=10)
