"""Messages to a hub that died or froze are not reported as sent."""

import signal
import time

import pytest

from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError
from tests.support.lab import NODES, Lab
from tests.support.running import eventually


@pytest.mark.thorough
def test_messages_to_a_restarted_hub_are_not_reported_as_sent(lab: Lab):
    lab.start("--set", "dynamics.start.z=1")
    old = lab.nodes()["hub"]["pid"]
    with lab.bare() as bare:
        heard = bare.watch("uav/own/key")
        said = lab.spawn(*lab.command("topic", "pub", "uav/own/key", "1", "-r", 20, "-n", 100_000))
        heard.next(3)
        lab.signal("hub", signal.SIGKILL)
    lab.revived("hub", old)
    assert said.wait() == 3, said.log
    # The second text appears if the command asks before the next hub is up.
    told = ("the hub was restarted during the command", "the connection to the hub is lost")
    assert any(text in said.log for text in told), said.log


@pytest.mark.thorough
def test_messages_to_a_frozen_hub_are_not_reported_as_sent(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=20")
    with lab.bare() as bare:
        heard = bare.watch("uav/own/key")
        words = ("topic", "pub", "uav/own/key", "1", "-r", 20, "-n", 100, "--timeout", 20)
        said = lab.spawn(*lab.command(*words))
        heard.next(3)
        lab.signal("hub", signal.SIGSTOP)
        # A client that receives nothing from the hub for a second drops it, then reconnects.
        eventually(lambda: not bare.session.info.routers_zid())
        time.sleep(1.0)
        lab.signal("hub", signal.SIGCONT)
    assert said.wait() == 3, said.log
    assert "the connection to the hub was lost for a moment" in said.log
    assert lab.nodes()["hub"]["restarts"] == 0


@pytest.mark.thorough
def test_ctrl_c_reports_the_messages_that_may_be_lost(lab: Lab):
    lab.start("--set", "dynamics.start.z=1")
    old = lab.nodes()["hub"]["pid"]
    with lab.bare() as bare:
        heard = bare.watch("uav/own/key")
        words = ("topic", "pub", "uav/own/key", "1", "-r", 20, "--timeout", 20)
        said = lab.spawn(*lab.command(*words))
        heard.next(3)
        lab.signal("hub", signal.SIGKILL)
        lab.revived("hub", old)
        heard.next(3)
    said.send(signal.SIGINT)
    assert said.wait() == 130
    assert "messages on uav/own/key some may be lost: " in said.log


@pytest.mark.thorough
def test_a_replay_checks_the_hub_and_not_its_own_session(lab: Lab, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(lab.runtime))
    lab.start(*(f"--without={node}" for node in NODES if node != "hub"))
    for _ in range(4):
        eventually(lab.is_ready)
        old = lab.nodes()["hub"]["pid"]
        with Client(lab.realm, "uav") as client:
            stage = client.stage({"uav/own": "text/plain"})
            client.flush()
            lab.signal("hub", signal.SIGKILL)
            stage.put("uav/own", b"1", "text/plain")
            with pytest.raises(QuadctlError):
                client.flush()
        lab.revived("hub", old)
