"""What runs: our nodes, the file's commands in their place or besides, and what is left out."""

import sys

import pytest

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.process_table import NODES, Process, table


def test_our_nodes_in_the_order_in_which_they_start():
    assert NODES == ("hub", "dynamics", "pressure", "safety")
    assert [process.name for process in table({})] == list(NODES)
    for process in table({}):
        assert process.command == (sys.executable, "-P", "-m", f"quadctl.services.{process.name}")
        assert process.must_announce


def test_the_gate_may_be_silent_for_longer_than_what_the_vehicle_flies_by():
    patience = {process.name: process.patience for process in table({}, gate=True)}
    assert patience == dict.fromkeys(NODES, 0.0) | {"gate": 10.0}


def test_a_command_takes_a_nodes_place_and_must_announce_itself():
    processes = table({"safety": "python 'my safety.py' --x"})
    assert processes[3] == Process("safety", ("python", "my safety.py", "--x"), True, True)
    assert len(processes) == 4


def test_other_commands_come_besides_in_the_files_order_and_need_not_announce():
    processes = table({"viewer": ["view", "a b"], "camera": "cam"})
    assert processes[4:] == (
        Process("viewer", ("view", "a b"), False, True),
        Process("camera", ("cam",), False, True),
    )


def test_any_of_them_can_be_left_out():
    assert [p.name for p in table({"cam": "cam"}, ["safety"])] == [
        "hub",
        "dynamics",
        "pressure",
        "cam",
    ]
    assert [p.name for p in table({"cam": "cam"}, ["cam", "hub"])] == list(NODES[1:])
    assert table({}, NODES) == ()


def test_what_is_not_there_cannot_be_left_out():
    with pytest.raises(Invalid, match="--without safty: there is no such process") as caught:
        table({"cam": "cam"}, ["safty"])
    assert "safety" in caught.value.hint
    assert "cam" in caught.value.hint


@pytest.mark.parametrize("command", ["", "   ", [], "python 'my_safety.py"])
def test_a_command_that_cannot_be_read_is_refused_by_its_name(command: str | list[str]):
    with pytest.raises(Invalid, match=r"processes\.safety: ") as caught:
        table({"safety": command})
    assert caught.value.hint


def test_a_bad_command_that_is_left_out_hurts_nobody():
    assert len(table({"safety": ""}, ["safety"])) == 3
