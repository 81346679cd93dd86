"""A limit of 64 open files: flights, strangers on the hub's socket, and tables of many keys."""

import socket
from contextlib import ExitStack

import pytest

from tests.support.bags import raw_message, write
from tests.support.lab import PATIENT, Lab
from tests.support.running import Done

FEW = 64


def with_few_files(lab: Lab, *words: object) -> Done:
    """Run a command, and the processes that it starts, with at most 64 open files each."""
    few = ["sh", "-c", f'ulimit -n {FEW}; exec "$@"', "sh"]
    return lab.run([*few, *lab.command(*words)], 60)


@pytest.mark.thorough
def test_a_flight_arrives_while_strangers_take_all_files_of_the_hub(lab: Lab):
    assert with_few_files(lab, "up", "-d", *PATIENT) == (0, f"realm {lab.realm} is up\n", "")
    before = lab.nodes()
    flight = lab.spawn(*lab.command("goto", 4, 4, 1))
    with ExitStack() as held:
        with lab.bare() as bare:
            bare.watch("uav/safety/state").until(lambda state: state["state"] == "MOVING")
        for _ in range(2 * FEW):
            stranger = held.enter_context(socket.socket(socket.AF_UNIX))
            stranger.settimeout(5)
            stranger.connect(str(lab.home / "hub.sock"))
        assert flight.wait() == 0, flight.log
    assert lab.quadctl("goto", 0, 0, 1, "--timeout", 10).code == 0
    assert lab.nodes() == before


def test_more_keys_than_open_files_are_exported(lab: Lab):
    sent = [
        raw_message(f"my/{n}", {"x": n}, n / 100, "application/msgpack") for n in range(3 * FEW)
    ]
    write(lab.folder / "many.mcap", sent)
    done = with_few_files(lab, "bag", "export", "many.mcap", "--csv")
    assert (done.code, done.err) == (0, "")
    last = lab.folder / "many" / f"my.{3 * FEW - 1}.csv"
    assert last.read_text().splitlines()[0] == "unix_time,x"
    assert len(list(last.parent.iterdir())) == 3 * FEW
