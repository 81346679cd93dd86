"""`doctor` on real systems: a healthy one, and each fault with its exit code."""

import os
import re
import signal
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

import pytest
import zenoh

from tests.support.bare import Bare, pack
from tests.support.doctored import Found, ask, glance
from tests.support.lab import NODES, Lab, private_lab
from tests.support.running import DEADLINE, Done, eventually


@pytest.mark.thorough
def test_doctor_reports_a_restarted_node_and_a_dead_one(lab: Lab):
    file = lab.file("[processes]\nextra = ['sh', '-c', 'echo no wings; exit 1']\n")
    run = lab.spawn(*lab.command("up", file))
    eventually(lambda: lab.nodes().get("extra", {}).get("state") == "down")
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


@pytest.mark.thorough
def test_doctor_reports_a_dead_run_and_its_leftover_folder(lab: Lab):
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


NEED_THE_HUB = {
    "announced", "schemas", "servers", "publishers", "topics", "services", "clocks", "barometer",
    "parameters",
}  # fmt: skip


@pytest.fixture(scope="module")
def unkilled() -> Iterator[Lab]:
    """Lab with a supervisor that does not kill frozen processes."""
    with private_lab() as made:
        made.share("--set", "supervise.answer_timeout=60", "--set", "dynamics.start.z=1")
        yield made


@pytest.fixture
def patient(unkilled: Lab) -> Lab:
    """That lab as launched, without a parameter file."""
    # A test before may have frozen the hub: each node then has to connect anew.
    eventually(lambda: unkilled.quadctl("node", "ping", "--all", "-n", 1).code == 0)
    unkilled.put_back()
    (unkilled.folder / "quad.toml").unlink(missing_ok=True)
    return unkilled


def test_a_healthy_system_has_no_fault_and_stays_unchanged(shared_lab: Lab, hover: Bare):
    before = hover.state()
    found = ask(shared_lab)
    assert found.failed == set()
    for name in ("realm", *(f"node {node}" for node in NODES), "hub answers", "announced"):
        found.said(name, "PASS")
    for name in (
        "schemas",
        "servers",
        "publishers",
        "barometer",
        *(f"services of {node}" for node in NODES),
    ):
        found.said(name, "PASS")
    for topic, hz in {
        "uav/pose": 100,
        "uav/sensors/pressure": 10,
        "uav/input/position": 20,
    }.items():
        assert f"Hz of {hz}" in found.checks[f"topic {topic}"]["evidence"]
    assert "dynamics.start.z is 1.0, there 0.0" in found.said("parameters", "WARN")
    after = hover.state()
    assert after | {"stamp": 0.0} == before | {"stamp": 0.0}


@pytest.mark.thorough
def test_doctor_works_as_text_and_with_only_the_hubs_endpoint(shared_lab: Lab):
    said = shared_lab.quadctl("doctor", "--timeout", "10")
    assert (said.code, said.err) == (0, "")
    assert "\nPASS  hub answers: " in said.out
    endpoint = f"unixsock-stream/{shared_lab.home / 'hub.sock'}"
    found = ask(shared_lab, "--connect", endpoint, "--realm", "nowhere")
    assert found.failed == set()
    found.said("services of safety", "PASS")
    assert "realm" not in found.checks


@pytest.mark.thorough
def test_doctor_finds_a_frozen_node(patient: Lab):
    with patient.bare() as bare, patient.frozen("pressure") as pid:
        # The hub drops it when its lease expires.
        eventually(lambda: "pressure" not in bare.nodes())
        found = ask(patient)
    assert found.failed == {"node pressure", "announced"}
    assert "frozen" in found.said("node pressure", "FAIL")
    assert f"kill -CONT {pid}" in found.checks["node pressure"]["fix"]
    assert found.said("announced", "FAIL") == "not on the bus: pressure"
    with patient.bare() as bare:
        eventually(lambda: "pressure" in bare.nodes())


@pytest.mark.thorough
def test_doctor_finds_an_announced_node_that_keeps_silent(patient: Lab):
    held: list[zenoh.Query] = []
    with patient.bare() as bare:
        key = "uav/@srv/mute/get_params"
        server = bare.session.declare_queryable(key, held.append, complete=True)
        offers = [
            "uav/@node/mute",
            "uav/@node/mute/@pub/Sound/0/10/uav%sound",
            "uav/@node/mute/@pub/Junk/0/10/no%%key",
            f"uav/@node/mute/@srv/GetParams/0/0/{key.replace('/', '%')}",
        ]
        tokens = [bare.session.liveliness().declare_token(offer) for offer in offers]
        found = ask(patient, "--timeout", "3")
        for token in tokens:
            token.undeclare()
        server.undeclare()
    for query in held:
        query.drop()
    assert "nothing came in" in found.said("topic uav/sound", "FAIL")
    assert "nothing came in" in found.said("topic no//key", "FAIL")
    assert "no answer within" in found.said("services of mute", "FAIL")
    assert "mute has GetParams#0" in found.said("schemas", "FAIL")


@pytest.mark.thorough
def test_doctor_ends_with_a_frozen_hub_and_skips_its_checks(patient: Lab):
    with patient.frozen("hub"):
        found = ask(patient, "--timeout", 0.3)
    assert found.failed == {"hub answers", "node hub"}
    for name in NEED_THE_HUB:
        assert found.said(name, "WARN") == "not checked: the hub does not answer"


@pytest.mark.thorough
def test_doctor_finds_second_servers_publishers_and_other_schemas(patient: Lab):
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(str(query.key_expr), pack({}))

    with patient.bare() as bare:
        offer = "uav/@node/mine/@pub/Pose/deadbeef/100/uav%pose"
        goto = bare.session.declare_queryable("uav/@srv/goto", answer, complete=True)
        tokens = [bare.session.liveliness().declare_token(key) for key in ("uav/@node/mine", offer)]
        mine = bare.session.new_timestamp().get_id()
        doctor = patient.spawn(*patient.command("doctor", "--json", "--timeout", "10"))

        def published() -> bool:
            # Stamped an hour ago, as by a clock that is behind.
            stamp = zenoh.Timestamp(datetime.now(UTC) - timedelta(hours=1), mine)
            bare.session.put("uav/sensors/pressure", pack({"stamp": 1.0}), timestamp=stamp)
            return doctor.ended

        eventually(published)
        for token in tokens:
            token.undeclare()
        goto.undeclare()
    found = Found(Done(doctor.wait(), doctor.log, ""))
    assert "uav/@srv/goto is served by safety and 1 more" in found.said("servers", "FAIL")
    doubled = found.said("publishers", "FAIL")
    assert "uav/pose is published by dynamics and mine" in doubled
    assert "uav/sensors/pressure is published by pressure and 1 more" in doubled
    assert "mine has Pose#deadbeef" in found.said("schemas", "FAIL")
    behind = found.said("clocks", "WARN")
    assert re.search(r"on uav/sensors/pressure is stamped 360\d\.\d s in the past", behind)
    found.said("topic uav/sensors/pressure", "WARN")


def test_doctor_finds_a_second_publisher_of_setpoints(patient: Lab):
    """Publish setpoints without announcing it; only safety may publish them."""
    with patient.bare() as bare:
        states = bare.watch("uav/safety/state")
        doctor = patient.spawn(*patient.command("doctor", "--json", "--timeout", "10"))

        def written() -> bool:
            pose = bare.watch("uav/pose").next()[0]
            where = {"position": {"x": 0.0, "y": 0.0, "z": 1.0}, "brake": False}
            bare.put("uav/input/position", {"boot": pose["boot"], "for_seq": pose["seq"], **where})
            return doctor.ended

        eventually(written)
        assert states.messages, "safety keeps publishing"
    found = Found(Done(doctor.wait(), doctor.log, ""))
    said = found.said("publishers", "FAIL")
    assert said == "uav/input/position is published by safety and 1 more, not announced"
    assert "`quadctl node list`" in found.checks["publishers"]["fix"]


@pytest.mark.thorough
def test_doctor_finds_a_readable_realm_and_a_missing_socket(patient: Lab):
    patient.home.chmod(0o755)
    assert "mode 0755" in glance(patient).said("realm", "FAIL")
    patient.home.chmod(0o700)
    socket, aside = patient.home / "hub.sock", patient.home / "aside"
    socket.rename(aside)
    found = glance(patient)
    aside.rename(socket)
    assert found.failed == {"realm", "hub answers"}
    assert "hub.sock is gone" in found.said("realm", "FAIL")


@pytest.mark.thorough
def test_doctor_finds_an_unwritable_realm(patient: Lab):
    done = subprocess.run(
        ["sh", "-c", 'ulimit -f 0; exec "$@"', "sh",
         *patient.command("doctor", "--json", "--timeout", "0.3")],
        env=patient.environment, capture_output=True, text=True, timeout=DEADLINE, check=False,
    )  # fmt: skip
    found = Found(Done(done.returncode, done.stdout, done.stderr))
    assert f"{patient.home} cannot be written to" in found.said("disk", "FAIL")
