"""An invalid, expired or revoked certificate gets nothing; a valid one works at once."""

import itertools
import shutil
import time
from pathlib import Path

import pytest
import zenoh

from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.security.registry import Registry
from tests.support.intruder import session
from tests.support.lab import PATIENT, Lab
from tests.support.network_field import TLS, Field, touched
from tests.support.proofs import Proofs
from tests.support.running import eventually

ENDPOINT = f"tls/127.0.0.1:{free_port()}"
LIMIT = 2.0
"""Seconds after `revoke` within which the last message must come."""
ROUNDS = 20


def time_to_last_message(fleet: Registry, folder: Path) -> float:
    """Return the seconds from `revoke` until the last message."""
    fleet.issue("operator", {"rob": ["*"]}, 1, [])
    came: list[float] = []

    def receive_then_revoke() -> bool:
        # The gate does not know the name before it reads the new list, and it takes no connection
        # while it opens again.
        try:
            opening = session(ENDPOINT, folder / "rob")
        except zenoh.ZError:
            return False
        with opening as opened:
            opened.declare_subscriber("uav/pose", lambda _: came.append(time.monotonic()))
            try:
                eventually(lambda: len(came) > 5)
            except AssertionError:
                return False
            fleet.revoke("rob")
            revoked.append(time.monotonic())
            time.sleep(LIMIT + 0.5)
            return True

    revoked: list[float] = []
    eventually(receive_then_revoke)
    return max(came) - revoked[0]


@pytest.mark.prove
def test_a_revoked_certificate_gets_nothing_after_two_seconds(lab: Lab, proofs: Proofs):
    assert lab.quadctl("keys", "init").code == 0
    assert lab.quadctl("keys", "issue", "hub").code == 0
    lab.start("--listen", ENDPOINT, "--identity", "keys/hub")
    keys = lab.folder / "keys"
    took = sorted(time_to_last_message(Registry(keys), keys) for _ in range(ROUNDS))
    proofs.add(
        "a revoked certificate: until its last message",
        f"{took[len(took) // 2] * 1000:.0f} ms, at most {took[-1] * 1000:.0f} ms (n {len(took)})",
        f"{LIMIT:g} s",
    )
    assert took[-1] < LIMIT


def test_clients_without_our_certificate_are_refused(net: Field):
    (net.operator.folder / "other").mkdir(exist_ok=True)
    other = net.operator.folder / "other" / "keys"
    for line in ("init", "issue operator anna"):
        assert net.operator.quadctl("keys", *line.split(), "--fleet", other).code == 0
    before = touched(net.vehicle)
    foreign = net.operator.quadctl("hold", "--connect", TLS, "--identity", other / "anna")
    assert foreign.code == 3
    assert "not a hub of our fleet" in foreign.err
    # This client accepts the hub's certificate, but its own is foreign: the hub must detect that.
    shutil.copy(net.keys / "ca.pem", other / "anna" / "ca.pem")
    refused = net.operator.quadctl("hold", "--connect", TLS, "--identity", other / "anna")
    assert refused.code == 3
    assert "rejects the certificate" in refused.err
    anonymous = net.operator.quadctl("hold", "--connect", TLS)
    assert anonymous.code == 2
    assert "--identity" in anonymous.err
    unencrypted = net.operator.quadctl("hold", "--connect", TLS.replace("tls/", "tcp/"))
    assert unencrypted.code in {3, 4}
    assert touched(net.vehicle) == before


@pytest.mark.thorough
def test_a_server_without_a_hub_certificate_is_refused(net: Field):
    posing = TLS.replace("7447", "7449")
    with net.impersonated_hub(posing, "bob"):
        done = net.ask("hold", at=posing)
    assert done.code == 3
    assert "not a hub of our fleet" in done.err


@pytest.mark.thorough
def test_a_new_certificate_works_at_once(net: Field):
    """Connect while the gate may still have the old list: the client retries until it has the new one."""
    for number in range(3):
        net.issue(f"operator new{number}")
        done = net.ask("hold", f"new{number}")
        assert done.code == 0, done.err


@pytest.mark.thorough
def test_an_expired_certificate_is_refused(net: Field):
    brief = net.issue("operator brief --days 0.00001")
    eventually(lambda: "expired on" in net.ask("hold", "brief").err)
    assert net.ask("hold", "brief").code == 3
    about = (brief / "identity.json").read_text(encoding="utf-8")
    # A client that claims a later expiry is still refused by the hub.
    (brief / "identity.json").write_text(
        about.replace('"expires":1', '"expires":9'), encoding="utf-8"
    )
    assert net.ask("hold", "brief").code == 3


def test_certificates_that_expire_in_flight_end_links_and_no_flight(lab: Lab):
    began = time.monotonic()
    for words in ("init", "issue operator anna"):
        assert lab.quadctl("keys", *words.split()).code == 0
    # Time enough for the run to start and for two commands to connect, also if the machine gets
    # busier meanwhile.
    seconds = 3 + 15 * (time.monotonic() - began)
    expires = time.time() + seconds
    for words in ("operator rob", "hub"):
        issued = lab.quadctl("keys", "issue", *words.split(), "--days", seconds / 86_400)
        assert issued.code == 0, issued.err
    lab.start("--listen", ENDPOINT, "--identity", "keys/hub", *PATIENT)

    def asks(name: str, *words: str) -> list[str]:
        return lab.command("--connect", ENDPOINT, "--identity", f"keys/{name}", *words)

    streams = [lab.spawn(*asks(name, "topic", "echo", "pose")) for name in ("rob", "anna")]
    eventually(lambda: all("position" in stream.log for stream in streams))
    before = lab.nodes()
    with lab.bare() as bare:
        states = bare.watch("uav/safety/state")
        for x in itertools.cycle((4.0, -4.0)):
            bare.fly(x, 0.0, 1.0)
            if time.time() > expires:
                break
        assert not [state["reason"] for state in states.messages if state["reason"]]
    assert [stream.wait() for stream in streams] == [3, 3]
    assert "expired" in lab.quadctl(*asks("anna", "hold")[-5:]).err
    assert lab.nodes() == before
    # The gate sees the new list of names and takes the new certificate.
    assert lab.quadctl("keys", "issue", "hub").code == 0
    eventually(lambda: lab.quadctl(*asks("anna", "hold")[-5:]).code == 0)


def test_a_revoked_name_is_out_and_the_flight_goes_on(net: Field):
    rob = net.copied_identity("rob")
    assert net.ask("hold", rob).code == 0
    stream = net.started("topic echo pose --json", rob)
    eventually(lambda: stream.log.count("\n") > 20)
    boot = touched(net.vehicle)[2]
    assert net.operator.quadctl("keys", "revoke", "rob").code == 0
    # The router and the vehicle read their own folders' lists, which `revoke` has written.
    counts: list[int] = []

    def silent() -> bool:
        counts.append(stream.log.count("\n"))
        return len(counts) > 50 and counts[-50] == counts[-1]

    eventually(silent)
    stream.end()
    done = net.ask("hold", rob)
    assert done.code == 3
    assert "lets nothing through for operator.rob." in done.err
    assert net.intrude(rob) == {"replied": [], "heard": [], "asked": [], "seen": []}
    # The other clients reconnect by themselves, and the vehicle is undisturbed.
    eventually(lambda: net.ask("hold").code == 0)
    assert touched(net.vehicle)[2] == boot
    restarts = {name: node["restarts"] for name, node in net.vehicle.nodes().items()}
    assert set(restarts.values()) == {0}, (
        restarts,
        net.vehicle.quadctl("node", "logs", "gate").out,
    )
