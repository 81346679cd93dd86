"""Types that several threads use first, and at once."""

import subprocess
import sys

RACE = """
import sys, threading
import msgspec
from quadctl.schemas.params import Params
from quadctl.services.runtime.typed import converted, from_json
sys.setswitchinterval(1e-6)
plain, start = msgspec.to_builtins(Params()), threading.Barrier(8)
found = []

def run():
    start.wait()
    found.append(converted(plain, Params))
    found.append(from_json(msgspec.json.encode(plain), Params))

threads = [threading.Thread(target=run) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
print(len(found), all(each == Params() for each in found))
"""


def test_threads_that_use_a_type_first_and_at_once_do_not_crash():
    # With msgspec alone every second process dies of a segmentation fault.
    for _ in range(6):
        done = subprocess.run(
            [sys.executable, "-c", RACE], capture_output=True, text=True, timeout=60, check=False
        )
        assert (done.returncode, done.stdout) == (0, "16 True\n"), done.stderr
