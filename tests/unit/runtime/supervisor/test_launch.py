"""Address of a run's hub, and the environment of its processes."""

import os
import socket
import sys
from pathlib import Path

import msgspec
import pytest

from quadctl.schemas.params import Params
from quadctl.services.runtime.bus.session import Address, address_of
from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.supervisor.launch import Launch, choose_address, hold


@pytest.fixture
def realm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Realm:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("quadctl.services.runtime.realm._LONGEST_SOCKET_PATH", 1000)
    made = Realm("lab")
    made.create()
    return made


@pytest.mark.parametrize("transport", ["auto", "unix"])
def test_the_hub_uses_a_unix_socket_in_the_realm_without_a_password(realm: Realm, transport: str):
    assert choose_address(realm, transport) == Address(f"unixsock-stream/{realm.socket}", "", "")


def loopback(address: Address) -> int:
    kind, _, port = address.endpoint.rpartition(":")
    assert kind == "tcp/127.0.0.1"
    assert len(address.user) >= 16
    assert len(address.password) >= 32
    return int(port)


def test_over_tcp_the_hub_uses_a_free_loopback_port_with_a_secret(realm: Realm):
    one, other = choose_address(realm, "tcp"), choose_address(realm, "tcp")
    assert (one.user, one.password) != (other.user, other.password)
    with socket.socket() as free:
        free.bind(("127.0.0.1", loopback(one)))


@pytest.mark.parametrize("lacking", ["platform", "family"])
def test_without_unix_sockets_auto_means_tcp(
    realm: Realm, monkeypatch: pytest.MonkeyPatch, lacking: str
):
    if lacking == "platform":
        monkeypatch.setattr(sys, "platform", "win32")
    else:
        monkeypatch.delattr(socket, "AF_UNIX")
    assert loopback(choose_address(realm, "auto")) > 1023


def test_the_address_is_read_from_the_realms_folder(realm: Realm):
    written = Address("tcp/127.0.0.1:7447", "user", "password")
    realm.address.write_bytes(msgspec.json.encode(written))
    assert address_of(realm) == written
    assert address_of(realm, "tls/host:7447") == Address("tls/host:7447")


def test_without_a_written_address_the_socket_is_assumed(realm: Realm):
    assert address_of(realm) == Address(f"unixsock-stream/{realm.socket}")


def test_a_realm_is_locked_by_one_run(realm: Realm):
    lock = hold(realm)
    with pytest.raises(
        AlreadyServed, match=f"the realm lab is already held by process {os.getpid()}"
    ) as caught:
        hold(realm)
    assert "--realm lab" in caught.value.hint
    lock.release()
    hold(realm).release()


def test_the_environment_of_a_child_has_its_realm_and_python():
    launch = Launch("lab", {"drone": Params()}, [], "/")
    found = launch.environment("safety", 3)
    assert (found["QUADCTL_REALM"], found["QUADCTL_VEHICLE"]) == ("lab", "drone")
    assert (found["QUADCTL_RESTARTS"], found["QUADCTL_SUPERVISED"]) == ("3", "1")
    assert found["QUADCTL_NODE"] == "safety"
    assert found["PATH"].endswith(os.environ["PATH"])
    first = Path(found["PATH"].split(os.pathsep)[0])
    assert (first / "python").exists()


def test_a_launch_round_trips_as_json():
    launch = Launch("lab", {"uav": Params(processes={"mine": ["a", "b"]})}, ["safety"], "/tmp")
    assert msgspec.json.decode(msgspec.json.encode(launch), type=Launch) == launch
