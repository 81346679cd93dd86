"""Our compiled step beside the same step by hand in C++, in one process, in alternating slices.

Both are so fast that their difference is smaller than the drift of the processor's speed between two
separate measurements.
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
