"""Runs on machines without shared memory, IPv6 or room in the realm's folder."""

import pytest

from tests.support.lab import PATIENT, Lab
from tests.support.poor_machines import WITHOUT_IPV6, WITHOUT_SHARED_MEMORY, poor, small_disk
from tests.support.running import Done

pytestmark = pytest.mark.needs("ip", "mounts")

FLIGHT = 'quadctl goto 1 0 1 --replace && echo "flown"'


def played(lab: Lab, machine: str, script: str) -> Done:
    """Run a script of commands on a machine of its own, and end the run there."""
    quadctl = " ".join(lab.command())
    words = f'quadctl() {{ {quadctl} "$@"; }}; {script}; quadctl down'
    done = lab.run([*poor(machine), "sh", "-c", words], 60)
    assert "Traceback" not in done.out + done.err, done
    return done


@pytest.mark.parametrize(
    "missing",
    [
        pytest.param(WITHOUT_SHARED_MEMORY, marks=pytest.mark.needs("shm"), id="shm"),
        pytest.param(WITHOUT_IPV6, marks=pytest.mark.needs("ipv6"), id="ipv6"),
    ],
)
def test_a_flight_needs_neither_shared_memory_nor_ipv6(lab: Lab, missing: str):
    done = played(lab, missing, f"quadctl up -d {' '.join(PATIENT)} && {FLIGHT}")
    assert (done.code, "flown" in done.out) == (0, True), done


@pytest.mark.thorough
def test_a_hub_without_its_address_says_so_in_one_line(lab: Lab):
    done = played(lab, WITHOUT_IPV6, "quadctl up -d --insecure --listen 'tcp/[::1]:7700'; echo $?")
    assert "1\n" in done.out, done
    assert "tcp/[::1]:7700 cannot be opened: " in done.err
    assert "Cannot assign requested address" in done.err
    assert "Cannot assign requested address" in lab.taken_logs()["hub.log"]


def test_a_run_whose_folder_fills_up_flies_on_and_keeps_its_values(lab: Lab):
    full = f"dd if=/dev/zero of={lab.runtime}/fill bs=1k 2> /dev/null"
    done = played(
        lab,
        small_disk(lab.runtime, "1m"),
        f"quadctl up -d {' '.join(PATIENT)} && {{ {full}; }}; {FLIGHT};"
        " quadctl param set safety.takeoff 1.5; echo set $?; quadctl param get safety.takeoff;"
        f" rm {lab.runtime}/fill; {FLIGHT}",
    )
    assert (done.code, done.out.count("flown")) == (0, 2), done
    assert "set 1\n" in done.out
    assert "No space left on device" in done.err
    assert "\n1.0\n" in done.out
