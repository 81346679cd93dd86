"""Which vehicle is meant where none is named."""

from functools import lru_cache

from services.runtime import run_files
from services.runtime.errors import Unreachable, UsageError
from services.runtime.realm import DEFAULT, HUB_ALONE, Realm, listed


def the_only(realm: str, connect: str, timeout: float) -> str:
    """The vehicle of a run that has one, `uav` where nothing runs; of a hub, where one is named.

    Raises UsageError where there are several, and over `connect` what a Client does (timeout in s).
    """
    there = of(realm, connect, timeout)
    if len(there) > 1 and DEFAULT not in there:
        raise UsageError(
            f"there are several vehicles: {listed(there)}",
            f"say which: --vehicle {there[0]}, or set QUADCTL_VEHICLE",
        )
    return there[0] if len(there) == 1 else DEFAULT


def of(realm: str, connect: str, timeout: float) -> list[str]:
    """The vehicles of a run, or of a hub where one is named; raises as `the_only` over that."""
    if connect:
        return _at(realm, connect, timeout)
    # At a hub alone, those of others that have joined it.
    return _at(realm, "", timeout) if hub_alone(realm) else _in(realm)


def in_run(realm: str) -> list[str]:
    """The vehicles of a run, as its record has them; none where nothing runs."""
    return [name for name in _in(realm) if not name.startswith(HUB_ALONE)]


def hub_alone(realm: str) -> str:
    """What the hub of a run without a vehicle goes by; empty where there is a vehicle, or no run."""
    there = _in(realm)
    return there[0] if there and there[0].startswith(HUB_ALONE) else ""


def _in(realm: str) -> list[str]:
    try:
        return run_files.read(Realm(realm)).vehicles
    except (Unreachable, UsageError):
        # Told by whoever needs the run, or the realm's name.
        return []


@lru_cache
def _at(realm: str, connect: str, timeout: float) -> list[str]:
    from services.runtime.bus.client import Client
    from services.runtime.security.endpoints import is_secure

    if is_secure(connect):
        from services.runtime.security.identity import needed

        # Who may see one vehicle means that one.
        if (ours := needed(connect).name.vehicles) != ["*"]:
            return ours
    with Client(realm, DEFAULT, connect=connect, timeout=timeout) as client:
        return client.vehicles()
