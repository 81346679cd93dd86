"""What the long counts have found, kept in a file that the README's table is made from.

`python -m tests.support.proofs` makes that table anew, as after a change of what is promised.
"""

from pathlib import Path

import msgspec

from benchmarks import machine, readme
from tests.promises.table import Proof, table

FILE = Path(__file__).parents[2] / "benchmarks" / "proofs.json"


class Proofs:
    """Collects what the tests of one run have found."""

    def __init__(self) -> None:
        self._found: list[Proof] = []

    def add(self, promise: str, found: str, promised: str) -> None:
        """What was found of a promise; whether it holds is for the test to assert."""
        self._found.append({"promise": promise, "found": found, "promised": promised})

    def write(self) -> None:
        """Put them in the place of what was found before, and the table into the README."""
        if not self._found:
            return
        about = machine.described()
        here = {name: about[name] for name in ("commit", "date", "processor")}
        kept = {proof["promise"]: proof for proof in read()}
        kept |= {proof["promise"]: proof | here for proof in self._found}
        FILE.write_bytes(msgspec.json.format(msgspec.json.encode(list(kept.values())), indent=1))
        tell()


def read() -> list[Proof]:
    """What has been found so far."""
    found: list[Proof] = msgspec.json.decode(FILE.read_bytes()) if FILE.exists() else []
    return found


def tell() -> None:
    """Make the README's table anew."""
    readme.replace("proofs", table(read()))


if __name__ == "__main__":
    tell()
