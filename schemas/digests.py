"""Digests of the types on the wire: to compute them takes a command 10 ms.

The digest of a type that has gained fields since a release is followed by those of its earlier
versions, the newest first: `1a2b3c4d.04033aed`. So a reader of a release, which cannot know the new
digest, finds its own. Written by `python -m tests.golden.write digests`; a test compares them with
the types and with the kept types of the releases.
"""

DIGESTS = {
    "quadctl.schemas.messages.Called": "07637e38",
    "quadctl.schemas.messages.Info": "bce24dd0",
    "quadctl.schemas.messages.Pose": "04033aed",
    "quadctl.schemas.messages.Poses": "df4c08cb",
    "quadctl.schemas.messages.Pressure": "331c5bf8",
    "quadctl.schemas.messages.SafetyState": "79572674",
    "quadctl.schemas.messages.Setpoint": "2667ef4f",
    "quadctl.schemas.messages.Waypoint": "74e295e2",
    "quadctl.schemas.messages.Zones": "55c4e57b",
    "quadctl.schemas.services.CalibrateRequest": "d4c4fd3c",
    "quadctl.schemas.services.CalibrateResponse": "5151684d",
    "quadctl.schemas.services.Call": "2e1e7fdf",
    "quadctl.schemas.services.GetParamsRequest": "50cf4abf",
    "quadctl.schemas.services.GetParamsResponse": "127a6040",
    "quadctl.schemas.services.GotoRequest": "d79826ed",
    "quadctl.schemas.services.GotoResponse": "282bc7c5",
    "quadctl.schemas.services.HoldRequest": "00000000",
    "quadctl.schemas.services.HoldResponse": "ed3119d1",
    "quadctl.schemas.services.ResetRequest": "00000000",
    "quadctl.schemas.services.ResetResponse": "ed3119d1",
    "quadctl.schemas.services.SetParamsRequest": "59c25547",
    "quadctl.schemas.services.SetParamsResponse": "75c4c978",
    "quadctl.schemas.services.ToggleCageRequest": "6ece6d4c",
    "quadctl.schemas.services.ToggleCageResponse": "ed3119d1",
}


def place(type_: type) -> str:
    """Return the name by which a type is listed: its module and its own name."""
    return f"{type_.__module__}.{type_.__qualname__}"


def go_together(one: str, other: str) -> bool:
    """Return whether of two sides' digests of a type one is the same as the other, or follows it."""
    ours, theirs = one.split("."), other.split(".")
    return ours[0] in theirs or theirs[0] in ours
