"""Errors of the system, each with the exit code of a command that fails with it.

    QuadctlError (1)
    ├── UsageError (2)
    ├── Unreachable (3)       no answer: not running, or died during the call
    │   └── NotAllowed        this certificate's role does not permit it
    ├── TimedOut (4)          the server is there but did not answer in time
    ├── Expired (4)           a command arrived after its deadline
    ├── Refused (5)           safety refused, or a node is not ready
    │   └── NotReady
    ├── Invalid (6)           a parameter, message or schema is not valid
    │   └── SchemaMismatch
    └── AlreadyServed (7)     another process holds that name or realm

`message` gives the event and its cause, `hint` the remedy. `code` is the name on the wire and with
`--json`.
"""

from collections.abc import Sequence


class QuadctlError(Exception):
    """Root of the tree: an error with a message, a hint and an exit code."""

    exit_code = 1
    code = "internal"

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint
        if hint:
            self.add_note(f"try: {hint}")  # the end of a traceback
        self.others: Sequence[str] = ()
        """Messages of less serious errors that occurred as well."""


class UsageError(QuadctlError):
    """Command line that cannot be parsed."""

    exit_code, code = 2, "usage"


class Unreachable(QuadctlError):
    """Server that is not there."""

    exit_code, code = 3, "unreachable"


class NotAllowed(Unreachable):
    """Request that the certificate's role does not permit, and so gets no answer."""

    code = "not_allowed"


class TimedOut(QuadctlError):
    """Server that is there but did not answer by the deadline."""

    exit_code, code = 4, "timeout"


class Expired(QuadctlError):
    """Command that reached its server after its deadline and was not executed."""

    exit_code, code = 4, "expired"


class Refused(QuadctlError):
    """Valid request that is not granted; `reason` in safety's own words."""

    exit_code, code = 5, "refused"

    def __init__(self, message: str, hint: str = "", *, reason: str = "") -> None:
        super().__init__(message, hint)
        self.reason = reason or message


class NotReady(Refused):
    """Request that the server cannot execute yet."""

    code = "not_ready"


class Invalid(QuadctlError):
    """Value, message or name that is not valid."""

    exit_code, code = 6, "invalid"


class SchemaMismatch(Invalid):
    """Type of which the two sides have different versions."""


class AlreadyServed(QuadctlError):
    """Name that another process already holds."""

    exit_code, code = 7, "already_served"


WIRE_ERRORS: dict[str, type[QuadctlError]] = {
    error.code: error for error in (QuadctlError, Expired, Refused, NotReady, Invalid)
}
"""Exceptions that error replies raise in the caller, by `code`."""
