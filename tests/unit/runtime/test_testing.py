"""A service is played from a list: calls are executed at their times, held ones within the message."""

from msgspec import to_builtins

from quadctl.schemas.messages import Called, Pose, Setpoint
from quadctl.schemas.params import Params
from quadctl.schemas.services import HoldRequest, HoldResponse
from quadctl.schemas.topics import HOLD, POSE, SETPOINT
from quadctl.services.runtime.testing import play
from tests.support.bags import pose


def call(stamp: float, *, held: bool = False, service: str = "hold", **request: object) -> Called:
    return Called("b0", stamp, service, held, dict(request), {}, "")


def diary(calls: list[Called], poses: int = 5, **params: float) -> list[str]:
    """What a service that writes everything down has to say."""
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

    heard = [(POSE, pose(seq)) for seq in range(poses)]
    said = play("safety", run, Params(), heard, calls)
    assert [to_builtins(each.message)["for_seq"] for each in said] == list(range(poses))
    return lines


def test_a_call_comes_after_the_message_of_its_time():
    lines = diary([call(0.02), call(0.02)])
    at = lines.index("hold")
    assert lines[at - 1 : at + 2] == ["pose 2", "hold", "hold"]


def test_held_call_comes_in_its_slice_without_other_services():
    assert [line for line in diary([call(0.01, held=True), call(0.03, service="goto")]) if line != "tick"] == [
        "pose 0", "pose 1", "hold", "pose 2", "pose 3", "pose 4",
    ]  # fmt: skip


def test_parameters_change_as_they_did():
    lines = diary([call(0.03, service="safety/set_params", values={"safety.takeoff": 2.0})])
    assert lines.index("takeoff 2") == lines.index("pose 3") + 1


def test_it_ticks_in_simulated_time():
    assert diary([], poses=100).count("tick") == 50
