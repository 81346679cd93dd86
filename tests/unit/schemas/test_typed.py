"""Types that several threads use first, and at once."""

import re
import subprocess
import sys

from tests.checks.test_structure import FOLDERS, ROOT

RACE = """
import sys, threading
import msgspec
from quadctl.schemas.typed import converted, from_json, json_decoder
from quadctl.schemas.typeinfo import described, json_schema
from quadctl.schemas.params import Params
sys.setswitchinterval(1e-6)
plain, start = msgspec.to_builtins(Params()), threading.Barrier(8)
text, found = msgspec.json.encode(plain), []
firsts = (
    lambda: described(Params) and Params(),
    lambda: json_schema(Params) and Params(),
    lambda: converted(plain, Params),
    lambda: from_json(text, Params),
    lambda: json_decoder(Params).decode(text),
)

def run(first):
    start.wait()
    found.append(first())
    found.append(converted(plain, Params))

threads = [threading.Thread(target=run, args=(firsts[n % 5],)) for n in range(8)]
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


def test_json_is_decoded_as_a_type_in_one_place_only():
    # The other uses of a type are banned in pyproject.toml, but this one has the name of a harmless one.
    found = [
        file.relative_to(ROOT).as_posix()
        for folder in FOLDERS
        for file in (ROOT / folder).rglob("*.py")
        if re.search(r"decode\([^)]*\btype=", file.read_text(encoding="utf-8"))
    ]
    assert found == ["schemas/typed.py"]
