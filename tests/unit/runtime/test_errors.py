"""Class tree of errors, and the exit code of each."""

import traceback

import pytest

from quadctl.services.runtime import errors
from quadctl.services.runtime.errors import QuadctlError, Refused

# From the contract, without 0, 8 (doctor, demo, campaign) and 130 (Ctrl-C), which are no errors.
EXIT = {
    "QuadctlError": (1, "internal"),
    "UsageError": (2, "usage"),
    "Unreachable": (3, "unreachable"),
    "NotAllowed": (3, "not_allowed"),
    "TimedOut": (4, "timeout"),
    "Expired": (4, "expired"),
    "Refused": (5, "refused"),
    "NotReady": (5, "not_ready"),
    "Invalid": (6, "invalid"),
    "SchemaMismatch": (6, "invalid"),
    "AlreadyServed": (7, "already_served"),
}
DECLARED = {
    name: thing
    for name, thing in vars(errors).items()
    if isinstance(thing, type) and issubclass(thing, Exception)
}


def test_the_declared_errors_match_the_contract():
    assert {name: (error.exit_code, error.code) for name, error in DECLARED.items()} == EXIT


@pytest.mark.parametrize("error", DECLARED.values())
def test_every_error_has_a_message_and_a_hint(error: type[QuadctlError]):
    assert issubclass(error, QuadctlError)
    made = error("what and why", "what to do")
    assert (str(made), made.message, made.hint) == ("what and why", "what and why", "what to do")
    assert error("alone").hint == ""


def test_the_docstring_shows_every_error_with_its_exit_code():
    lines = (errors.__doc__ or "").splitlines()
    for name, (code, _) in EXIT.items():
        line = next(line for line in lines if name in line)
        inherited = DECLARED[name].__base__
        assert f"({code})" in line or getattr(inherited, "exit_code", None) == code


def test_five_codes_are_sent_on_the_wire():
    assert set(errors.WIRE_ERRORS) == {"invalid", "refused", "not_ready", "expired", "internal"}
    assert all(error.code == code for code, error in errors.WIRE_ERRORS.items())


def test_a_traceback_ends_with_the_hint():
    text = "".join(traceback.format_exception(Refused("no", "ask again")))
    assert text.endswith("Refused: no\ntry: ask again\n")
    assert not hasattr(Refused("no"), "__notes__")
