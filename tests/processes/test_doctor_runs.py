"""doctor on systems that live otherwise: other speeds, restarts, deaths, nodes by hand."""

import os
import signal

from tests.processes.doctored import ask, glance
from tests.processes.lab import Lab
from tests.processes.running import eventually


def test_at_another_speed_rates_are_of_simulated_time(lab: Lab):
    lab.start("--set", "dynamics.speed=5")
    found = ask(lab)
    assert found.failed == set()
    assert "(simulated time)" in found.checks["topic uav/pose"]["evidence"]


def test_a_node_that_was_restarted_and_one_that_is_down(lab: Lab):
    file = lab.file("[processes]\nextra = ['sh', '-c', 'echo no wings; exit 1']\n")
    run = lab.spawn(*lab.command("up", file))
    eventually(lambda: lab.nodes().get("extra", {}).get("state") == "down", 30.0)
    eventually(lambda: lab.nodes()["safety"]["state"] == "ready")
    lab.revived("pressure", lab.signal("pressure", signal.SIGKILL))
    found = ask(lab)
    assert "restarted once" in found.said("node pressure", "WARN")
    assert "down" in found.said("node extra", "FAIL")
    assert "no wings" in found.said("node extra", "FAIL")
    assert "quadctl node logs extra" in found.checks["node extra"]["fix"]
    assert found.failed == {"node extra"}
    run.send(signal.SIGINT)
    assert run.wait() == 130


def test_a_run_that_died_is_a_fault_and_its_folder_a_leftover(lab: Lab):
    lab.start("--without", "safety")
    os.kill(lab.status()["pid"], signal.SIGKILL)
    eventually(lambda: not lab.processes())
    found = glance(lab)
    assert found.failed == {"realm"}
    assert "has died" in found.said("realm", "FAIL")
    assert found.checks["realm"]["fix"].startswith("`quadctl up -d`")
    other = glance(lab, "--realm", "other")
    assert other.failed == set()
    assert lab.realm in other.said("leftovers", "WARN")
    lab.start()
    glance(lab).said("realm", "PASS")


def test_nodes_that_were_started_by_hand(lab: Lab):
    hub = lab.spawn(*lab.command()[:2], "-m", "quadctl.services.hub")
    bare = lab.first_bare()
    eventually(lambda: bare.nodes() == ["hub"])
    bare.session.close()
    found = glance(lab)
    assert "by hand" in found.said("realm", "WARN")
    hub.send(signal.SIGTERM)
    assert hub.wait() == 0
    lab.start()
