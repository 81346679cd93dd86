"""What the long counts have found, kept in a file that the README's table is made from."""

from pathlib import Path
from typing import Any

import msgspec

from benchmarks import machine, readme

FILE = Path(__file__).parents[1] / "benchmarks" / "proofs.json"

Proof = dict[str, Any]
"""`promise`, what was `found`, what is `promised`; `commit`, `date` and `processor` of the run."""


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
        readme.replace("proofs", table(list(kept.values())))


def read() -> list[Proof]:
    """What has been found so far."""
    found: list[Proof] = msgspec.json.decode(FILE.read_bytes()) if FILE.exists() else []
    return found


def table(proofs: list[Proof]) -> str:
    """The README's table."""
    rows = ["| promise | found | promised | commit |", "|---|---|---|---|"]
    rows += [
        f"| {proof['promise']} | {proof['found']} | {proof['promised']} | {proof['commit']} |"
        for proof in proofs
    ]
    processors = sorted({proof["processor"] for proof in proofs})
    rows += ["", f"Found by `make prove` on {', '.join(processors)}."]
    return "\n".join(rows) + "\n"
