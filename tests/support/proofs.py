"""Results of the long counts, kept in a file from which the table of docs/promises.md is made."""

import msgspec

from benchmarks import machine
from tests.promises.table import FILE, Proof, proofs


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
        from docs.draw import PROMISES, write  # reads every declaration

        about = machine.described()
        here = {name: about[name] for name in ("commit", "date", "processor")}
        kept = {proof["promise"]: proof for proof in proofs()}
        kept |= {proof["promise"]: proof | here for proof in self.found}
        FILE.write_bytes(msgspec.json.format(msgspec.json.encode(list(kept.values())), indent=1))
        write(PROMISES)
