"""How a command for several vehicles tells what came of each, and which exit code is all of it."""

from collections.abc import Mapping, Sequence
from typing import Any

from cli.fleet.file import Member
from cli.options import Options
from services.runtime.errors import QuadctlError

_WORST_LAST = (5, 6, 7, 4, 3, 1)
"""Exit codes: a vehicle that refuses is known to be well, one that does not answer is not."""


def fail(problems: Mapping[str, QuadctlError]) -> None:
    """Raise the worst vehicle's problem, where there is one, and the others' with it."""
    if not problems:
        return
    *others, worst = sorted(problems.items(), key=lambda item: _gravity(item[1]))
    name, problem = worst
    whole = type(problem)(f"{name}: {problem.message}", problem.hint)
    whole.others = [f"{other}: {less.message}" for other, less in others]
    raise whole


def nobody_sent(problems: Mapping[str, QuadctlError], names: Sequence[str]) -> QuadctlError:
    """Why a centre was no goal for any of the vehicles: of some, these, nobody knows the place."""
    worst = max(problems.values(), key=_gravity)
    said = "; ".join(f"{name}: {problem.message}" for name, problem in problems.items())
    there = next((name for name in names if name not in problems), "")
    return type(worst)(
        f"nobody was sent: the formation's centre needs all of them; {said}",
        f"name those you mean: `quadctl fleet goto {there}=1,2,1`" if there else worst.hint,
    )


def row(member: Member, options: Options, problem: QuadctlError | None, **more: Any) -> Any:
    """A vehicle's part of the document."""
    error = None
    if problem is not None:
        error = {"code": problem.code, "message": problem.message, "hint": problem.hint}
    return {"vehicle": member.name, "hub": hub_of(member, options), **more, "error": error}


def hub_of(member: Member, options: Options) -> str:
    """Its hub's endpoint, or the realm."""
    return member.connect or f"realm {options.realm}"


def _gravity(problem: QuadctlError) -> int:
    code = problem.exit_code
    return _WORST_LAST.index(code) if code in _WORST_LAST else len(_WORST_LAST)
