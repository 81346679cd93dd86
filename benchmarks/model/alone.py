"""Compiled fleet, and its step alone, without setpoint generator and pilot."""

from collections.abc import Callable
from types import ModuleType

from benchmarks.model.vehicles import STEPS, flying, send
from quadctl.services.dynamics.compiled import kernel, source
from quadctl.services.dynamics.compiled.fleet import CompiledFleet

_ALONE = """
@njit(error_model='numpy', nogil=True, cache=True)
def alone(blocks, constants, steps, every):
    for b in range(blocks.shape[0]):
        for count in range(0, steps, 2):
            if count % 4 == every:
                _act(blocks[b], constants[b])
            _calm2(blocks[b], constants[b])
"""


def compiled() -> ModuleType:
    return source.load_module("benchmark", kernel.kernel_source() + _ALONE)


def on_their_way(
    count: int, module: ModuleType
) -> tuple[CompiledFleet, Callable[[int, int], None]]:
    """Return a fleet, and a function that steps it without a setpoint, STEPS steps a call.

    The function's second argument is the control step among every four; -1 for none.
    """
    fleet = CompiledFleet([flying()] * count, module)
    send(fleet.goto, count)
    fleet.fly(200)

    def run(calls: int, every: int) -> None:
        for _ in range(calls):
            module.alone(fleet.blocks, fleet.constants, STEPS, every)

    return fleet, run
