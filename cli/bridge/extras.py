"""Packages that a bridge needs beyond quadctl's own."""

from importlib.util import find_spec

from quadctl.schemas.roles import BRIDGES
from quadctl.services.runtime.errors import QuadctlError, UsageError

_NEEDS = {"foxglove": "websockets", "mavlink": "pymavlink", "ros2": "xxhash"}


def require(bridge: str) -> None:
    """Raise UsageError for an unknown bridge, QuadctlError if its extra is not installed."""
    if bridge not in BRIDGES:
        raise UsageError(f"there is no bridge {bridge}", f"one of {', '.join(BRIDGES)}")
    if find_spec(_NEEDS[bridge]) is None:
        raise QuadctlError(
            f"the bridge {bridge} needs the package {_NEEDS[bridge]}, which is not installed",
            f"`pip install 'quadctl[{bridge}]'`, into the same environment",
        )
