"""Which faults are in, by what this machine knows of the run: no bus is needed to tell."""

from typing import Any

from cli.options import Options
from services.runtime import procfs, run_files
from services.runtime import run_files as files
from services.runtime.errors import Unreachable
from services.runtime.params.names import flatten
from services.runtime.realm import Realm
from services.runtime.run_files import RunRecord


def kept(options: Options) -> dict[str, Any]:
    """The vehicle's parameters; over --connect as the nodes answer."""
    if options.connect:
        return _asked(options)
    realm = Realm(options.realm)
    run_files.read(realm)
    return values_of(realm, options.vehicle)


def values_of(realm: Realm, vehicle: str) -> dict[str, Any]:
    """A vehicle's parameters by the realm's folder."""
    return dict(flatten(files.tables(realm, vehicle)))


def _asked(options: Options) -> dict[str, Any]:
    from cli import bus
    from schemas.services import GetParamsRequest
    from schemas.topics import get_params

    with bus.connect(options) as client:
        replies = [
            client.call(get_params(node), GetParamsRequest([])) for node in ("dynamics", "pressure")
        ]
    return {name: value for reply in replies for name, value in reply.values.items()}


def frozen(options: Options) -> list[str]:
    """The processes of the run that are stopped by a signal, as `safety-frozen`."""
    if options.connect:
        return []
    try:
        run = run_files.read(Realm(options.realm))
    except Unreachable:
        return []
    return frozen_of(run)


def frozen_of(run: RunRecord) -> list[str]:
    """The same, of this run."""
    return [f"{node.name}-frozen" for node in run.nodes if node.pid and procfs.is_frozen(node.pid)]
