"""Our compiled fleet, and its step alone, without setpoint and pilot."""

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
    """A fleet, and what takes its vehicles through calls of STEPS steps each with no setpoint.

    Of every four steps the one with this number is a control step; with -1 none is.
    """
    fleet = CompiledFleet([flying()] * count, module)
    send(fleet.goto, count)
    fleet.advance(200)

    def run(calls: int, every: int) -> None:
        for _ in range(calls):
            module.alone(fleet.blocks, fleet.constants, STEPS, every)

    return fleet, run
