"""`fuzz`: no service of the lab accepts an unreadable payload, and a service that does is reported."""

import signal

import pytest
import zenoh

from tests.support.bare import pack
from tests.support.lab import Lab
from tests.support.running import eventually


@pytest.mark.thorough
def test_no_service_accepts_five_hundred_fuzzed_payloads(shared_lab: Lab):
    done = shared_lab.quadctl("fuzz", "--payloads", 500, "--seed", 7, "--json")
    assert done.code == 0, done.out
    found = done.json
    assert (found["ok"], found["payloads"], found["seed"], found["faults"]) == (True, 500, 7, [])
    assert found["replies"] == {"invalid": found["asked"]}
    told = shared_lab.quadctl("fuzz", "--payloads", 50)
    assert told.code == 0
    assert "none was accepted, no process ended, and each answers the next valid call" in told.out


@pytest.mark.thorough
def test_fuzz_reports_a_service_that_accepts_every_payload(lab: Lab):
    lab.start("--without", "pressure")
    with lab.bare() as bare:
        key = "uav/@srv/calibrate_pressure"

        def credulous(query: zenoh.Query) -> None:
            with query:
                query.reply(key, pack({"baseline": 0.0}))

        server = bare.session.declare_queryable(key, credulous)
        eventually(lambda: bare.answers(key, b""))
        done = lab.quadctl("fuzz", "--payloads", 300, "--json")
        server.undeclare()
    assert done.code == 8
    took, unanswered = done.json["faults"]
    assert took.startswith("uav/@srv/calibrate_pressure took ")
    # No other service of pressure is running.
    assert unanswered.endswith("calls were not answered")


@pytest.mark.thorough
def test_fuzz_reports_a_frozen_service_in_time(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=60")
    lab.signal("pressure", signal.SIGSTOP)
    done = lab.quadctl("fuzz", "--payloads", 300, "--timeout", 0.7, "--json")
    lab.signal("pressure", signal.SIGCONT)
    assert done.code == 8
    assert any("were not answered" in fault for fault in done.json["faults"])
