"""Vehicles of a run or of a hub: those that are there, and the one that is meant."""

from functools import lru_cache

from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Unreachable, UsageError
from quadctl.services.runtime.realm import DEFAULT, HUB_ALONE, Realm, listed


def only_vehicle(realm: str, connect: str, timeout: float) -> str:
    """Return the only vehicle of a run, or of a hub if `connect` names one; `uav` if nothing runs.

    Of several vehicles, return `uav`; without one of that name, raise UsageError. With `connect`,
    raise what a Client raises (timeout in s).
    """
    names = vehicles_of(realm, connect, timeout)
    if len(names) > 1 and DEFAULT not in names:
        hint = f"choose one: --vehicle {names[0]}, or set QUADCTL_VEHICLE"
        raise UsageError(f"there are several vehicles: {listed(names)}", hint)
    return names[0] if len(names) == 1 else DEFAULT


def vehicles_of(realm: str, connect: str, timeout: float) -> list[str]:
    """Return a run's vehicles, or a hub's with `connect`, which raises what a Client raises."""
    if connect:
        return _on_hub(realm, connect, timeout)
    names = _recorded(realm)
    # A hub without a vehicle has those of the other hubs that have joined it.
    return _on_hub(realm, "", timeout) if _of_hub_alone(names) else names


def in_run(realm: str) -> list[str]:
    """Return the vehicles in a run's record; none if nothing runs."""
    return [name for name in _recorded(realm) if not name.startswith(HUB_ALONE)]


def standalone_hub(realm: str) -> str:
    """Return the name of the hub of a run without a vehicle; empty with a vehicle, or no run."""
    return _of_hub_alone(_recorded(realm))


def _of_hub_alone(names: list[str]) -> str:
    return names[0] if names and names[0].startswith(HUB_ALONE) else ""


def _recorded(realm: str) -> list[str]:
    try:
        return run_files.read(Realm(realm)).vehicles
    except (Unreachable, UsageError):
        # Reported by the caller that needs the run or the realm's name.
        return []


@lru_cache
def _on_hub(realm: str, connect: str, timeout: float) -> list[str]:
    from quadctl.services.runtime.bus.client import Client
    from quadctl.services.runtime.security.endpoints import is_secure

    if is_secure(connect):
        from quadctl.services.runtime.security.identity import needed

        # An identity that may see only some vehicles means these.
        if (ours := needed(connect).name.vehicles) != ["*"]:
            return ours
    with Client(realm, DEFAULT, connect=connect, timeout=timeout) as client:
        return client.vehicles()
