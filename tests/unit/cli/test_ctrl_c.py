"""A Ctrl-C that comes where Python or msgspec ignores what is raised comes again, until it is heard."""

import random
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")

TRIAL = """
import _thread, importlib, msgspec, random, signal, sys, threading, time
from typing import Annotated
import quadctl.cli.command
from quadctl.cli import main
work = {work}
draws, lost = random.Random({seed}), 0
def press(seconds):
    time.sleep(seconds)
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
def command():
    global lost
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {{signal.SIGINT}})  # blocked since main.py
    sys.setswitchinterval(1e-6)
    for number in range({count}):
        begun = time.perf_counter()
        work(number)
        took = time.perf_counter() - begun
        try:
            # Thread.start waits, and fails in its own way if it is interrupted there.
            _thread.start_new_thread(press, (draws.uniform(0, took),))
            work({count} + number)
            for _ in range(100):  # one that comes just before a sleep does not shorten it
                time.sleep(0.02)
            lost += 1
        except KeyboardInterrupt:
            pass
    print(lost)
    raise SystemExit
quadctl.cli.command.main = command
main.main()
"""
TYPES = """lambda number: [msgspec.convert({"x": 1.0}, msgspec.defstruct(f"A{number}_{n}", [
    ("x", Annotated[float, msgspec.Meta(ge=0)], 0.0), ("y", dict[str, float] | None, None)]))
    for n in range(10)]"""
IMPORTS = """lambda number: [sys.modules.pop(name, None) or importlib.import_module(name)
    for name in ("colorsys", "tomllib", "tomllib._parser")]"""


@pytest.mark.parametrize("work", [TYPES, IMPORTS], ids=["types", "imports"])
def test_no_ctrl_c_is_lost(work: str):
    seed = random.randrange(10**6)
    text = TRIAL.format(work=work, seed=seed, count=200)
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=False, timeout=120
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", ""), seed
