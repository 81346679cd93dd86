"""Results of the long counts, kept in a file from which the table of docs/promises.md is made.

`python -m tests.support.proofs` writes that table again, e.g. after a promise has changed.
"""

from pathlib import Path

import msgspec

from benchmarks import machine
from benchmarks.tables import replace
from tests.promises.table import Proof, table

FILE = Path(__file__).parents[2] / "benchmarks" / "proofs.json"


class Proofs:
    """Results that the tests of one run have found."""

    def __init__(self) -> None:
        self.found: list[Proof] = []

    def add(self, promise: str, found: str, promised: str) -> None:
        """Add the result of a promise; the test itself asserts that the promise holds."""
        self.found.append({"promise": promise, "found": found, "promised": promised})

    def write(self) -> None:
        """Replace the earlier results of the same promises, in the file and on the page."""
        if not self.found:
            return
        about = machine.described()
        here = {name: about[name] for name in ("commit", "date", "processor")}
        kept = {proof["promise"]: proof for proof in read()}
        kept |= {proof["promise"]: proof | here for proof in self.found}
        FILE.write_bytes(msgspec.json.format(msgspec.json.encode(list(kept.values())), indent=1))
        write_table()


def read() -> list[Proof]:
    """Return the results so far."""
    found: list[Proof] = msgspec.json.decode(FILE.read_bytes()) if FILE.exists() else []
    return found


def write_table() -> None:
    """Write the table of docs/promises.md."""
    replace("promises.md", "proofs", table(read()))


if __name__ == "__main__":
    write_table()
