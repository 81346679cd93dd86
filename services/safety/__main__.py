"""Safety's process: verifies every goal, and alone tells the vehicle where to go."""

from schemas.geometry import Position
from schemas.messages import CageSize, Info, Pose, SafetyState, Waypoint
from schemas.params import Params
from schemas.requests import (
    GotoRequest,
    GotoResponse,
    HoldRequest,
    HoldResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from schemas.topics import (
    GOTO,
    HOLD,
    INFO,
    POSE,
    REQUEST,
    SERVICES,
    SETPOINT,
    STATE,
    TOGGLE_CAGE,
    TOPICS,
)
from services.runtime.entry import start
from services.runtime.errors import NotReady
from services.runtime.node import Node
from services.runtime.params import launch_lines
from services.safety.cage import bounds
from services.safety.monitor import Monitor

_FIRST_POSE = 1.0
"""How long (s) readiness waits for a first pose, so that who sees us ready can fly."""


def run(node: Node, params: Params) -> None:
    """Step on the poses at 20 Hz; a clock of our own watches that they keep coming."""
    states, setpoints = node.publisher(STATE), node.publisher(SETPOINT)
    info = node.publisher(INFO)

    def tell(state: SafetyState, line: str) -> None:
        states.put(state)
        if line:
            node.log.info(line)

    monitor = Monitor(params.safety, tell, restarted=node.restarted)
    answered = -1

    def on_pose(pose: Pose) -> None:
        nonlocal answered
        period = SETPOINT.period(pose.stamp)
        if pose.boot == monitor.situation.boot and period == answered:
            return
        answered = period
        monitor.see(pose)
        setpoints.put(monitor.setpoint())

    def on_waypoint(waypoint: Waypoint) -> None:
        monitor.ask(Position(waypoint.x, waypoint.y, waypoint.z))

    def goto(request: GotoRequest) -> GotoResponse:
        goal = Position(request.x, request.y, request.z)
        reason = monitor.ask(goal, replace=request.replace)
        setpoints.put(monitor.setpoint())
        return GotoResponse(not reason, reason)

    def hold(_request: HoldRequest) -> HoldResponse:
        if not monitor.situation.boot:
            raise NotReady("no pose yet: dynamics is silent")
        monitor.hold()
        setpoints.put(monitor.setpoint())
        return HoldResponse(True)

    def toggle_cage(request: ToggleCageRequest) -> ToggleCageResponse:
        monitor.toggle(cage_on=request.cage_on)
        if monitor.situation.boot:
            setpoints.put(monitor.setpoint())
        return ToggleCageResponse(monitor.situation.cage_on is request.cage_on)

    poses = node.listen(POSE, on_pose)
    node.listen(REQUEST, on_waypoint)
    node.serve(GOTO, goto)
    node.serve(HOLD, hold)
    node.serve(TOGGLE_CAGE, toggle_cage)
    node.on_params = monitor.resize
    _log_launch(node, params)
    info.put(_info(node.vehicle))
    states.put(monitor.state())
    node.wait_for(lambda: monitor.fresh, _FIRST_POSE)

    last_tick = 0.0
    for count, now in enumerate(node.ticks(SETPOINT.hz)):
        # A loop that was itself held up has not yet seen the poses that wait for it.
        held_up, last_tick = now - last_tick > 2 / SETPOINT.hz, now
        if poses.age > params.safety.pose_timeout and not held_up and params.dynamics.speed == 1:
            monitor.lose()
            if monitor.situation.boot:
                setpoints.put(monitor.setpoint())
        if count % SETPOINT.hz == 0:
            states.put(monitor.state())


def _log_launch(node: Node, params: Params) -> None:
    """The lab's lines: the cage as intervals, the rest as it is."""
    size = params.safety.virtual_cage
    intervals = bounds(CageSize(size.x, size.y, size.z))
    for line in launch_lines(params.safety):
        axis = line.removeprefix("Param: virtual cage ")[:1]
        if line.startswith("Param: virtual cage "):
            low, high = intervals[axis]
            node.log.info("Param: cage %s - [%s, %s]", axis, low, high)
        else:
            node.log.info(line)
    if node.restarted:
        node.log.warning("restarted: the cage is on")


def _info(vehicle: str) -> Info:
    return Info(
        vehicle,
        {service.name: service.node for service in SERVICES},
        {topic.name: topic.node for topic in TOPICS},
    )


if __name__ == "__main__":
    start("safety", run)
