"""Ours compiled beside the same by hand in C++, in one process and in turn, slice by slice.

Both go through code that is as fast as it can be, so that what tells them apart is less than what
the processor's speed wanders between two measurements.
"""

import json

from benchmarks.model import alone
from benchmarks.model.figures import PAIRED
from benchmarks.model.peers.timing import in_turn
from benchmarks.model.reference import Reference, hovering
from benchmarks.model.vehicles import STEPS


def main() -> None:
    """Print the ratio of steps without a controller."""
    count = PAIRED.count
    _, run = alone.on_their_way(count, alone.compiled())
    reference = Reference()
    states, commands = reference.blocks(hovering(), count)

    def theirs(calls: int) -> None:
        for _ in range(calls):
            reference.run("dynamics", states, commands, STEPS)

    print(json.dumps({PAIRED.key: in_turn(lambda calls: run(calls, -1), theirs)}))


if __name__ == "__main__":
    main()
