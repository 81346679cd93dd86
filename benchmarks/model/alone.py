"""Our compiled fleet, and its step alone, without setpoint and pilot."""

from collections.abc import Callable
from types import ModuleType

from benchmarks.model.vehicles import STEPS, flying, send
from services.dynamics.fleet import kernel
from services.dynamics.fleet.compiled import CompiledFleet
from services.runtime import generated

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
    return generated.load("benchmark", kernel.source() + _ALONE)


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
