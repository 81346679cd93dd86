"""Process table: nodes, commands of the file, and processes left out; restart policy."""

import sys

import pytest
from hypothesis import given, strategies as st

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.process_table import (
    HEALTHY,
    MOST_QUICK_DEATHS,
    NODES,
    QUICK,
    SETTLED,
    START_TIMEOUT,
    Process,
    RestartPolicy,
    cut_off,
    table,
)

TIMEOUT = 2.0


class Child:
    """Process that starts, lives for a given time and dies."""

    def __init__(self) -> None:
        self.life, self.now = RestartPolicy(), 100.0

    def lives(self, ready_for: float | None) -> float | None:
        """Die some seconds after readiness (None: before it), and return the delay."""
        self.life.started(self.now)
        self.now += 0.5
        if ready_for is not None:
            self.life.ready(self.now)
            self.now += ready_for
        return self.life.on_exit(self.now)


@pytest.mark.parametrize("ready_for", [None, 0.0, 1.99])
def test_after_five_quick_deaths_with_growing_delays_a_process_is_down(ready_for: float | None):
    child = Child()
    assert [child.lives(ready_for) for _ in range(5)] == [0.0, 0.1, 0.2, 0.4, None]
    assert child.life.state == "down"
    assert child.life.restarts == 4


def test_the_limits_are_those_of_the_contract():
    assert (QUICK, HEALTHY, MOST_QUICK_DEATHS) == (2.0, 10.0, 5)


def test_a_death_after_two_seconds_is_not_quick():
    child = Child()
    assert [child.lives(2.0) for _ in range(20)] == [0.0] * 20
    assert child.life.restarts == 20


def test_ten_healthy_seconds_reset_the_count():
    child = Child()
    assert [child.lives(None) for _ in range(4)][-1] == 0.4
    assert child.lives(10.0) == 0.0
    assert [child.lives(None) for _ in range(5)] == [0.0, 0.1, 0.2, 0.4, None]


def test_fewer_healthy_seconds_do_not_reset_the_count():
    child = Child()
    assert [child.lives(None) for _ in range(4)][-1] == 0.4
    assert child.lives(9.9) == 0.4
    assert child.lives(None) is None


@given(st.lists(st.none() | st.floats(0, 30), max_size=40))
def test_five_quick_deaths_without_ten_healthy_seconds_mean_down(
    lives: list[float | None],
):
    child, quick = Child(), 0
    for ready_for in lives:
        lived = 0.0 if ready_for is None else ready_for
        # On the same clock, so that it rounds alike.
        start = child.now + 0.5
        lived = (start + lived) - start
        quick = 0 if lived >= HEALTHY else quick
        quick += lived < QUICK
        delay = child.lives(ready_for)
        assert (delay is None) is (quick >= MOST_QUICK_DEATHS)
        if delay is None:
            return


def test_the_state_is_starting_then_ready_then_restarting():
    life = RestartPolicy()
    assert life.state == "starting"
    life.started(0.0)
    life.ready(1.0)
    assert life.state == "ready"
    life.on_exit(5.0)
    assert life.state == "restarting"
    life.started(5.0)
    life.ready(6.0)
    assert (life.state, life.restarts) == ("ready", 1)


def test_repeated_readiness_counts_from_the_first():
    life = RestartPolicy()
    life.started(0.0)
    life.ready(1.0)
    life.ready(11.5)
    life.on_exit(11.5)
    for _ in range(4):
        assert life.on_exit(12.0) is not None
    assert life.on_exit(12.0) is None


def test_a_process_that_does_not_become_ready_times_out():
    life = RestartPolicy()
    life.started(5.0)
    assert life.timed_out(5.0 + START_TIMEOUT - 0.01, TIMEOUT) == ""
    assert life.timed_out(5.0 + START_TIMEOUT, TIMEOUT) == "not ready in 10 s"
    # One that may be silent for long may take as long to start.
    assert life.timed_out(5.0 + START_TIMEOUT, 40.0) == ""
    assert life.timed_out(45.0, 40.0) == "not ready in 40 s"
    life.started(20.0)
    assert life.timed_out(21.0, TIMEOUT) == ""


def test_silence_counts_only_after_the_first_answer():
    life = RestartPolicy()
    life.started(0.0)
    life.ready(1.0)
    assert life.timed_out(100.0, TIMEOUT) == ""
    life.answered(100.0)
    assert life.timed_out(102.0, TIMEOUT) == ""
    assert life.timed_out(102.01, TIMEOUT) == "no answer for 2 s"
    life.answered(102.01)
    assert life.timed_out(103.0, TIMEOUT) == ""
    # The next process of that name has not answered yet, so is not silent either.
    life.on_exit(103.0)
    life.started(103.0)
    life.ready(104.0)
    assert life.timed_out(200.0, TIMEOUT) == ""


def test_the_silence_of_a_node_counts_from_its_readiness():
    life = RestartPolicy(must_answer=True)
    life.started(0.0)
    assert life.timed_out(9.0, TIMEOUT) == ""
    life.ready(9.0)
    assert life.timed_out(11.0, TIMEOUT) == ""
    assert life.timed_out(11.01, TIMEOUT) == "no answer for 2 s"
    life.on_exit(11.01)
    life.started(11.01)
    assert life.timed_out(20.0, TIMEOUT) == ""


def test_a_watchdog_reset_excuses_silence():
    life = RestartPolicy()
    life.started(0.0)
    life.reset_watchdog(9.0)
    assert life.timed_out(15.0, TIMEOUT) == ""
    assert life.timed_out(19.0, TIMEOUT) == "not ready in 10 s"
    life.ready(19.0)
    life.reset_watchdog(30.0)
    assert life.timed_out(300.0, TIMEOUT) == ""
    life.answered(300.0)
    life.reset_watchdog(310.0)
    assert life.timed_out(311.0, TIMEOUT) == ""
    assert life.timed_out(312.5, TIMEOUT) == "no answer for 2 s"


def test_a_wait_for_a_processor_counts_in_no_limit():
    life = RestartPolicy(must_answer=True)
    life.started(0.0)
    life.excuse(50.0)
    assert life.timed_out(50.0 + START_TIMEOUT - 0.01, TIMEOUT) == ""
    assert life.timed_out(50.0 + START_TIMEOUT, TIMEOUT) == "not ready in 10 s"
    life.ready(60.0)
    life.excuse(3.0)
    assert life.timed_out(63.0 + TIMEOUT, TIMEOUT) == ""
    assert life.timed_out(63.0 + TIMEOUT + 0.01, TIMEOUT) == "no answer for 2 s"
    # It has lived for 1.9 s: on a busy machine, too, five such ends leave it down.
    for _ in range(4):
        assert life.on_exit(64.9) is not None
        life.started(65.0)
        life.ready(65.0)
        life.excuse(60.0)
    assert life.on_exit(126.9) is None


def ready_at(now: float) -> RestartPolicy:
    life = RestartPolicy(must_answer=True)
    life.started(now)
    life.ready(now)
    return life


def test_a_frozen_hub_excuses_the_silence_of_the_others():
    hub, node = ready_at(0.0), ready_at(0.0)
    node.answered(10.0)
    hub.answered(10.1)
    assert not cut_off(hub, 11.1, TIMEOUT)
    # The node answered a little earlier, but it must not be killed first.
    assert node.timed_out(12.05, TIMEOUT)
    assert not hub.timed_out(12.05, TIMEOUT)
    assert cut_off(hub, 12.05, TIMEOUT)
    hub.on_exit(12.2)
    assert cut_off(hub, 12.2, TIMEOUT)


def test_the_silence_of_a_node_counts_while_the_hub_answers():
    hub, node = ready_at(0.0), ready_at(0.0)
    hub.answered(2.0)
    assert node.timed_out(2.1, TIMEOUT)
    assert not cut_off(hub, 2.1, TIMEOUT)
    assert not cut_off(hub, 2.4, 0.5), "a hub that answers each ping is not late"
    assert not cut_off(None, 100.0, TIMEOUT)


def test_while_its_name_is_taken_a_process_retries_forever():
    life = RestartPolicy()
    for _ in range(4):
        life.on_exit(1.0)
    for number in range(50):
        life.started(float(number))
        assert life.on_exit(float(number), 7) == 0.8
        assert (life.state, life.name_taken) == ("restarting", True)
    life.started(60.0)
    life.ready(60.0)
    assert not life.name_taken
    assert life.on_exit(60.0, 1) is None, "the earlier deaths still count"


def test_the_exit_code_of_an_unannounced_command_has_no_meaning():
    life = RestartPolicy(must_announce=False)
    assert [life.on_exit(1.0, 7) for _ in range(5)][-1] is None
    assert not life.name_taken


def test_a_command_without_announcement_is_ready_after_a_moment():
    life, node = RestartPolicy(must_announce=False), RestartPolicy()
    for one in (life, node):
        one.started(1.0)
        one.runs(1.0 + SETTLED / 2)
        assert one.state == "starting"
        one.reset_watchdog(1.0 + SETTLED / 2)
        one.runs(1.0 + SETTLED)
    assert (life.state, node.state) == ("ready", "starting")


def test_a_requested_restart_clears_earlier_deaths():
    child = Child()
    assert [child.lives(None) for _ in range(5)][-1] is None
    child.life.on_restart_request()
    assert (child.life.state, child.life.restarts) == ("restarting", 5)
    assert [child.lives(None) for _ in range(5)] == [0.0, 0.1, 0.2, 0.4, None]


def test_the_nodes_are_listed_in_their_start_order():
    assert NODES == ("hub", "dynamics", "pressure", "safety")
    assert [process.name for process in table({})] == list(NODES)
    for process in table({}):
        assert process.command == (sys.executable, "-P", "-m", f"quadctl.services.{process.name}")
        assert process.must_announce


def test_the_gate_may_be_silent_for_longer_than_the_flight_nodes_and_the_hub_with_many_vehicles():
    patience = {process.name: process.patience for process in table({}, gate=True)}
    assert patience == dict.fromkeys(NODES, 0.0) | {"hub": 0.02, "gate": 10.0}
    assert table({}, vehicles=1000)[0].patience == 20.0


def test_a_command_can_replace_a_node_and_must_announce_itself():
    processes = table({"safety": "python 'my safety.py' --x"})
    assert processes[3] == Process("safety", ("python", "my safety.py", "--x"), True, True)
    assert len(processes) == 4


def test_further_commands_keep_the_file_order_and_need_not_announce():
    processes = table({"viewer": ["view", "a b"], "camera": "cam"})
    assert processes[4:] == (
        Process("viewer", ("view", "a b"), False, True),
        Process("camera", ("cam",), False, True),
    )


def test_any_process_can_be_left_out():
    assert [p.name for p in table({"cam": "cam"}, ["safety"])] == [
        "hub",
        "dynamics",
        "pressure",
        "cam",
    ]
    assert [p.name for p in table({"cam": "cam"}, ["cam", "hub"])] == list(NODES[1:])
    assert table({}, NODES) == ()


def test_an_unknown_process_cannot_be_left_out():
    with pytest.raises(Invalid, match="--without safty: there is no such process") as caught:
        table({"cam": "cam"}, ["safty"])
    assert "safety" in caught.value.hint
    assert "cam" in caught.value.hint


@pytest.mark.parametrize("name", ["saftey", "Safety", "dynamic", "presure"])
def test_a_misspelt_node_is_refused_with_the_one_meant(name: str):
    with pytest.raises(Invalid, match=rf"processes\.{name}: ") as caught:
        table({name: "python mine.py"})
    assert "did you mean" in caught.value.hint


@pytest.mark.parametrize("name", ["safety_2", "safety2", "camera", "logger", "hub-2", "planner"])
def test_a_node_of_ones_own_has_any_other_name(name: str):
    assert name in [process.name for process in table({name: "python mine.py"})]


@pytest.mark.parametrize("command", ["", "   ", [], "python 'my_safety.py"])
def test_an_invalid_command_is_refused_with_its_name(command: str | list[str]):
    with pytest.raises(Invalid, match=r"processes\.safety: ") as caught:
        table({"safety": command})
    assert caught.value.hint


def test_an_invalid_command_that_is_left_out_is_ignored():
    assert len(table({"safety": ""}, ["safety"])) == 3
