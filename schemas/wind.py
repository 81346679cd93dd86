"""The air that the vehicle flies in."""

from typing import Annotated

from msgspec import Meta, Struct, field

WindSpeed = Annotated[float, Meta(ge=-30, le=30)]


class MeanWindParams(Struct, forbid_unknown_fields=True):
    """The steady wind: where the air goes, ENU, m/s."""

    x: WindSpeed = 0.0
    y: WindSpeed = 0.0
    z: WindSpeed = 0.0


class WindParams(Struct, forbid_unknown_fields=True):
    """The air, made the same again at each boot by `dynamics.seed`."""

    mean: Annotated[
        MeanWindParams,
        Meta(description="steady wind, the way that the air goes", extra={"unit": "m/s"}),
    ] = field(default_factory=MeanWindParams)
    gust: Annotated[
        float, Meta(ge=0, le=20, description="RMS of gusts on each axis", extra={"unit": "m/s"})
    ] = 0.0
    gust_length: Annotated[
        float, Meta(ge=0.1, le=1000, description="length scale of gusts", extra={"unit": "m"})
    ] = 10.0
