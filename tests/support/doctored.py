"""Reports of doctor about a system, by check."""

from tests.support.lab import Lab
from tests.support.running import Done


class Found:
    """Checks of a report by name; the document and the exit code must agree."""

    def __init__(self, done: Done) -> None:
        assert done.err == ""
        for check in done.json["checks"]:
            assert set(check) == {"name", "verdict", "evidence", "fix"}
            assert check["verdict"] in {"PASS", "WARN", "FAIL"}
        self.checks = {check["name"]: check for check in done.json["checks"]}
        assert len(self.checks) == len(done.json["checks"])
        assert done.json["ok"] == (not self.failed)
        assert done.code == (8 if self.failed else 0)

    @property
    def failed(self) -> set[str]:
        return {name for name, check in self.checks.items() if check["verdict"] == "FAIL"}

    def said(self, name: str, verdict: str) -> str:
        """Return the evidence of a check that must have this verdict."""
        check = self.checks[name]
        assert check["verdict"] == verdict, check
        evidence: str = check["evidence"]
        return evidence


def ask(lab: Lab, *words: object) -> Found:
    """Run doctor with a long timeout, needed only if a node does not answer."""
    return Found(lab.quadctl("doctor", "--json", "--timeout", "10", *words))


def glance(lab: Lab, *words: object) -> Found:
    """Run doctor without time for the bus: it still makes the other checks."""
    return ask(lab, "--timeout", "0.3", *words)
