"""The order of a straight line."""

from collections.abc import Iterable

from services.dynamics.fleet.straight.operations import Operation


def ordered(results: Iterable[Operation]) -> list[Operation]:
    """What the results need, each operation after its operands and as near to its use as may be.

    What was just made is then still in the processor's first cache, and little is kept for later.
    """
    line: list[Operation] = []
    done: set[Operation] = set()
    waiting = list(results)[::-1]
    while waiting:
        operation = waiting[-1]
        needs = [x for x in operation.operands if isinstance(x, Operation) and x not in done]
        if operation in done or not needs:
            waiting.pop()
            if operation not in done:
                done.add(operation)
                line.append(operation)
        else:
            waiting += needs[::-1]
    return line
