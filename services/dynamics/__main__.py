"""Process of the vehicle: flies to the newest setpoint, and brakes without one."""

import math

from quadctl.schemas.params import Params
from quadctl.schemas.services import ResetRequest, ResetResponse
from quadctl.schemas.topics import RESET
from quadctl.services.dynamics.compiler import BackgroundCompiler
from quadctl.services.dynamics.simulation import Simulation
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.load import launch_lines

_compiler = BackgroundCompiler()
"""Shared by all vehicles of the process."""


def run(node: Node, params: Params) -> None:
    """Publish the pose at its rate; in missions and at speeds other than 1, in lock-step."""
    for line in launch_lines(
        params.dynamics, node.reference_params and node.reference_params.dynamics
    ):
        node.log.info(line)
    # For one vehicle in real time, plain Python is fast enough and needs far less memory.
    if many := not node.single or params.dynamics.speed != 1:
        _compiler.start()
    simulation = Simulation(node, params, _compiler.single if many else None)

    def reset(_request: ResetRequest) -> ResetResponse:
        simulation.reset(server.call.boot if server.call else "")
        return ResetResponse(True)

    server = node.serve(RESET, reset)
    node.on_params, node.in_force = simulation.configure, simulation.in_force
    dynamics = params.dynamics
    last_tick = 0.0
    simulation.publish()
    for now in node.ticks(lambda: dynamics.rate * (dynamics.speed or math.inf)):
        if dynamics.speed != 1 or node.in_mission:
            simulation.wait_for_safety()
        # After a delay of this loop itself, the setpoints in its queue count first.
        elif now - simulation.last_setpoint > dynamics.setpoint_timeout > now - last_tick or (
            last_tick and now - last_tick > max(dynamics.grace, dynamics.setpoint_timeout)
        ):
            simulation.brake()
        simulation.advance()
        last_tick = now


if __name__ == "__main__":
    start("dynamics", run)
