"""What goes with every call, whatever its service: its id and deadline, and its errors."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

ErrorCode = Literal["invalid", "refused", "not_ready", "expired", "internal"]


class Error(Struct, frozen=True):
    """An error reply: what went wrong, and what to do."""

    code: ErrorCode
    message: str
    hint: str = ""


class Call(Struct, frozen=True):
    """A query's attachment: executed once by `id`, and never after `deadline` (Unix time, s)."""

    id: Annotated[str, Meta(min_length=1, max_length=64)]
    deadline: Annotated[float, Meta(ge=0, le=1e12)]
