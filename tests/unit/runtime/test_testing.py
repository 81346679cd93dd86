"""Replay of a node from a list: calls run at their times, scheduled ones within a message."""

from msgspec import to_builtins

from quadctl.schemas.messages import Called, Pose, Setpoint
from quadctl.schemas.params import Params
from quadctl.schemas.services import HoldRequest, HoldResponse
from quadctl.schemas.topics import HOLD, POSE, SETPOINT
from quadctl.services.runtime.testing import play
from tests.support.bags import pose


def call(stamp: float, *, held: bool = False, service: str = "hold", **request: object) -> Called:
    return Called("b0", stamp, service, held, dict(request), {}, "")


def replayed_lines(calls: list[Called], poses: int = 5, **params: float) -> list[str]:
    """Replay a node that logs everything, and return its lines."""
    lines: list[str] = []

    def run(node, params: Params) -> None:
        out = node.publisher(SETPOINT)

        def on_pose(pose: Pose) -> None:
            lines.append(f"pose {pose.seq}")
            node.advance_sim_time(pose.boot, pose.stamp)
            out.put(Setpoint(pose.boot, pose.seq, pose.position, False))

        def on_hold(_request: HoldRequest) -> HoldResponse:
            lines.append("hold")
            return HoldResponse(True)

        node.listen(POSE, on_pose)
        node.on_params = lambda: lines.append(f"takeoff {params.safety.takeoff:g}")
        assert node.wait_for(lambda: bool(lines), 1.0)
        node.serve(HOLD, on_hold)
        lines.extend("tick" for _ in node.ticks(50))

    received = [(POSE, pose(seq)) for seq in range(poses)]
    published = play("safety", run, Params(), received, calls)
    assert [to_builtins(each.message)["for_seq"] for each in published] == list(range(poses))
    return lines


def test_a_call_is_executed_after_the_message_of_its_time():
    lines = replayed_lines([call(0.02), call(0.02)])
    at = lines.index("hold")
    assert lines[at - 1 : at + 2] == ["pose 2", "hold", "hold"]


def test_a_scheduled_call_is_executed_within_its_message():
    lines = replayed_lines([call(0.01, held=True), call(0.03, service="goto")])
    assert [line for line in lines if line != "tick"] == [
        "pose 0", "pose 1", "hold", "pose 2", "pose 3", "pose 4",
    ]  # fmt: skip


def test_recorded_parameter_changes_are_replayed():
    lines = replayed_lines(
        [call(0.03, service="safety/set_params", values={"safety.takeoff": 2.0})]
    )
    assert lines.index("takeoff 2") == lines.index("pose 3") + 1


def test_the_node_ticks_in_simulated_time():
    assert replayed_lines([], poses=100).count("tick") == 50
