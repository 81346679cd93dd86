"""Cores that stay awake during a measurement."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

# It ends with its parent, even by kill -9. Where each session is a group of the scheduler, the priority
# counts within the group only; the group itself gets the least that there is. It gives up each turn at once:
# else Linux 6.18 lets a process that wakes up wait for milliseconds, until the turn ends.
_LOOP = """
import os, sys, time
core, parent = map(int, sys.argv[1:])
os.sched_setaffinity(0, {core})
os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
while os.path.exists("/proc/self/autogroup"):
    try:
        with open("/proc/self/autogroup", "w") as file:
            file.write("19")
        break
    except BlockingIOError:  # of users other than root Linux takes one in 0.1 s
        time.sleep(0.1)
while os.getppid() == parent:
    for _ in range(10_000):
        os.sched_yield()
"""


@contextmanager
def awake() -> Iterator[None]:
    """Run a loop on each core that gives way to everything else, where the system has such a priority.

    A core that sleeps between two messages wakes up slowly, with a low clock and cold caches: on some
    machines a message then takes three times the processor time that it takes on others.
    """
    if not hasattr(os, "SCHED_IDLE"):
        yield
        return
    loops = [
        subprocess.Popen(
            [sys.executable, "-c", _LOOP, str(core), str(os.getpid())], start_new_session=True
        )
        for core in os.sched_getaffinity(0)
    ]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
