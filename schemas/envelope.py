"""What goes with every call, whatever its service: its id and deadline, and its errors."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.units import Boot, Seconds

ErrorCode = Literal["invalid", "refused", "not_ready", "expired", "internal"]


class Error(Struct, frozen=True):
    """An error reply: what went wrong, and what to do."""

    code: ErrorCode
    message: str
    hint: str = ""


class Call(Struct, frozen=True):
    """A query's attachment: executed once by `id`, and never after `deadline` (Unix time, s).

    With `at` (simulated s) the server holds the call, and executes and answers it at the first
    pose of that time or later that it steps on, of the named `boot` or else of the one that is
    now. A call whose time or boot is over is not executed. A `reset` begins the boot it names.
    """

    id: Annotated[str, Meta(min_length=1, max_length=64)]
    deadline: Annotated[float, Meta(ge=0, le=1e12)]
    at: Seconds | None = None
    boot: Boot = ""
