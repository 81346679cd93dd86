"""What can go wrong with the simulated flight, to order."""

from typing import Annotated, Literal

from msgspec import Meta, Struct


class FlightFaultParams(Struct, forbid_unknown_fields=True):
    """What is wrong with the vehicle, and with the pose that is told of it."""

    pose: Annotated[
        Literal["none", "frozen", "delayed", "jump"],
        Meta(
            description="frozen: the last one again and again; delayed: old ones; jump: off the"
            " true place",
            extra={"unit": ""},
        ),
    ] = "none"
    delay: Annotated[
        float,
        Meta(gt=0, le=10, description="how old a delayed pose is", extra={"unit": "s"}),
    ] = 0.5
    jump: Annotated[
        float,
        Meta(ge=-1000, le=1000, description="how far off a pose jumps, in x", extra={"unit": "m"}),
    ] = 3.0
    motors: Annotated[
        float,
        Meta(
            ge=0.5,
            le=1,
            description="share of their thrust that the motors give, unknown to the controller",
            extra={"unit": ""},
        ),
    ] = 1.0
