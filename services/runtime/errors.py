"""Errors of the system, each with the exit code of a command that ends with it.

    QuadctlError (1)
    ├── UsageError (2)
    ├── Unreachable (3)       nobody answers: not running, died in mid-call
    │   └── NotAllowed        this certificate's role does not extend to it
    ├── TimedOut (4)          somebody is there but did not answer in time
    ├── Expired (4)           a command that came after its deadline
    ├── Refused (5)           safety said no, or a node is not ready
    │   └── NotReady
    ├── Invalid (6)           a parameter, message or schema that cannot be
    │   └── SchemaMismatch
    └── AlreadyServed (7)     another process holds that name or realm

Each carries what happened and why (`message`) and what to do (`hint`). `code` is the name
used on the wire and with `--json`.
"""

from collections.abc import Sequence


class QuadctlError(Exception):
    """The root: an error with a message, a hint and an exit code."""

    exit_code = 1
    code = "internal"

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint
        self.others: Sequence[str] = ()
        """What else went wrong meanwhile, less grave than this: a message each."""


class UsageError(QuadctlError):
    """The command line cannot be understood."""

    exit_code, code = 2, "usage"


class Unreachable(QuadctlError):
    """Nobody answers."""

    exit_code, code = 3, "unreachable"


class NotAllowed(Unreachable):
    """Who asks has no right to it, and so is not answered."""

    code = "not_allowed"


class TimedOut(QuadctlError):
    """A server is there but did not answer by the deadline."""

    exit_code, code = 4, "timeout"


class Expired(QuadctlError):
    """A command reached its server after its deadline and was not executed."""

    exit_code, code = 4, "expired"


class Refused(QuadctlError):
    """The request is sound but is not granted."""

    exit_code, code = 5, "refused"


class NotReady(Refused):
    """The server cannot do this yet."""

    code = "not_ready"


class Invalid(QuadctlError):
    """A value, message or name that cannot be."""

    exit_code, code = 6, "invalid"


class SchemaMismatch(Invalid):
    """The two sides know different versions of a type."""


class AlreadyServed(QuadctlError):
    """Another process already holds that name."""

    exit_code, code = 7, "already_served"


WIRE_ERRORS: dict[str, type[QuadctlError]] = {
    error.code: error for error in (QuadctlError, Expired, Refused, NotReady, Invalid)
}
"""Which exception an error reply becomes at the caller's side, by its `code`."""
