"""Process of the vehicle: flies to the newest setpoint, and brakes without one."""

import time

from quadctl.schemas.params import Params
from quadctl.schemas.services import ResetRequest, ResetResponse
from quadctl.schemas.topics import RESET
from quadctl.services.dynamics.compiler import BackgroundCompiler
from quadctl.services.dynamics.formation import Formation
from quadctl.services.dynamics.simulation import Simulation
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.followed_params import follow
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.load import launch_lines

_compiler = BackgroundCompiler()
"""Shared by all vehicles of the process."""
_RECEIVED_WITHIN, _LOOK = 0.5, 0.005
"""Longest wait (s) of a restarted process for one that receives its poses, and the time between two looks."""
_formations: dict[int, Formation] = {}
"""Formations of the process, by the number of the nodes that tick together."""


def run(node: Node, params: Params) -> None:
    """Publish the pose at its rate, in real time or in lock-step."""
    for line in launch_lines(
        params.dynamics, node.reference_params and node.reference_params.dynamics
    ):
        node.log.info(line)
    # For one vehicle in real time, plain Python is fast enough and needs far less memory.
    if many := not node.single or params.dynamics.speed != 1:
        _compiler.start()
    formation = None
    if not (node.single or params.dynamics.in_lockstep):
        if node.executor.group not in _formations:
            _formations[node.executor.group] = Formation(node.executor.every_together, _compiler)
        formation = _formations[node.executor.group]
    simulation = Simulation(node, params, _compiler if many else None, formation)

    def reset(_request: ResetRequest) -> ResetResponse:
        simulation.reset(server.call.boot if server.call else "")
        return ResetResponse(True)

    server = node.serve(RESET, reset)
    node.on_params, node.in_force = simulation.configure, simulation.in_force
    # New body, gains and limits are judged by the guards of safety as they are now.
    follow(node, "safety", params, lambda: None)
    if node.restarted:
        _wait_for_receiver(node, simulation)
    simulation.publish()
    simulation.advance_time()
    try:
        node.every(simulation.tick_rate, simulation.tick)
    finally:
        _formations.clear()  # a new session begins with new ones


def _wait_for_receiver(node: Node, simulation: Simulation) -> None:
    """Wait until the first pose can be sent: a goal that comes once we are ready would be for the old boot."""
    until = time.monotonic() + _RECEIVED_WITHIN
    while not node.wait_for(lambda: simulation.is_received, _LOOK):
        if node.stopping or time.monotonic() > until:
            return


if __name__ == "__main__":
    start("dynamics", run, keeps_time=True)
