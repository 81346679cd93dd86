"""`fuzz`: what nobody may take, thrown at every topic and service of a live run."""

import random
import sys
from collections.abc import Iterator
from itertools import cycle, islice
from typing import Annotated, Any, NamedTuple

from msgspec import Struct

from cli import bus, output
from cli.declare import Opt
from cli.fuzz.payloads import Payload, refused
from cli.lab.progress import Progress
from cli.options import Options, here
from schemas.services import GetParamsRequest
from schemas.topics import SERVICES, STATE, TOPICS, get_params, set_params
from services.runtime import run_files
from services.runtime.bus.client import Client
from services.runtime.bus.volley import Volley
from services.runtime.errors import QuadctlError, Unreachable
from services.runtime.process_table import NODES
from services.runtime.realm import Realm
from services.runtime.security.endpoints import is_secure

_FAULT_FOUND = 8


class _Target(NamedTuple):
    key: str
    type: type[Struct]
    is_service: bool


def fuzz(
    options: Options,
    payloads: Annotated[int, Opt("How many to send, all told.", metavar="N", min=1)] = 2_000,
    seed: Annotated[int, Opt("Of the random numbers that they are made from.", min=0)] = 0,
) -> None:
    """Throw payloads that nobody may take at every topic and service, and see that none is taken.

    Noise, valid ones with bits flipped, cut or mislabelled, NaN and infinity in every field, deep
    nesting. Exit 8 where one was taken or not answered, a process ended, or afterwards a valid call
    got no answer. For a vehicle that nobody else is flying.

    Example: quadctl fuzz --payloads 100000 --seed 1
    """
    if is_secure(options.connect):
        # What a role keeps out would prove nothing.
        here(options, "fuzz")
    with bus.connect(options) as client:
        before = _look(client, options)
        volley = Volley(client)
        with Progress("throwing", quiet=options.json) as progress:
            for number, (target, payload) in enumerate(_plan(client.vehicle, payloads, seed)):
                if not _throw(volley, target, payload):
                    break
                if number % 100 == 0:
                    progress.update(number / payloads, f"{number} of {payloads}")
        volley.settle()
        faults = [*_faults(volley), *_changes(before, _look(client, options))]
        faults += _silent(client)
    document = {
        "ok": not faults, "payloads": volley.asked + volley.published, "seed": seed,
        "published": volley.published, "asked": volley.asked, "replies": dict(volley.codes),
        "faults": faults,
    }  # fmt: skip
    if options.json:
        output.document(document)
    else:
        _tell(document)
    if faults:
        sys.exit(_FAULT_FOUND)


def _plan(vehicle: str, count: int, seed: int) -> Iterator[tuple[_Target, Payload]]:
    topics = [_Target(topic.key(vehicle), topic.type, False) for topic in TOPICS]
    params = [make(node) for node in NODES for make in (get_params, set_params)]
    services = [_Target(s.key(vehicle), s.request, True) for s in (*SERVICES, *params)]
    draw = random.Random(seed)
    streams = [
        (target, refused(target.type, draw, called=target.is_service))
        for target in (*topics, *services)
    ]
    for target, stream in islice(cycle(streams), count):
        yield target, next(stream)


def _throw(volley: Volley, target: _Target, payload: Payload) -> bool:
    if target.is_service:
        return volley.ask(target.key, payload.data, payload.encoding, payload.attachment)
    volley.publish(target.key, payload.data, payload.encoding)
    return True


def _look(client: Client, options: Options) -> dict[str, Any]:
    """What must be the same afterwards."""
    client.flush()
    state = client.latest(STATE)
    found: dict[str, Any] = {
        "boot": state.boot, "requests": state.request, "goal": state.goal, "cage_on": state.cage_on,
    }  # fmt: skip
    try:
        run = None if options.connect else run_files.read(Realm(options.realm))
    except Unreachable:
        run = None
    return found | {f"process of {node.name}": node.pid for node in (run.nodes if run else ())}


def _faults(volley: Volley) -> Iterator[str]:
    for key in sorted(set(volley.taken)):
        yield f"{key} took {volley.taken.count(key)}"
    missing = volley.asked - volley.answered + volley.codes["no answer"]
    if missing:
        yield f"{missing} calls were not answered"


def _changes(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    for name, value in before.items():
        if after.get(name) != value:
            yield f"{name}: {value} before, {after.get(name)} after"


def _silent(client: Client) -> Iterator[str]:
    for node in client.nodes():
        try:
            client.call(get_params(node), GetParamsRequest([]))
        except QuadctlError as problem:
            yield f"{node} does not answer a valid call: {problem.message}"


def _tell(document: dict[str, Any]) -> None:
    output.line(
        f"{document['payloads']} payloads, seed {document['seed']}: {document['published']}"
        f" published, {document['asked']} asked"
    )
    for code, count in sorted(document["replies"].items()):
        output.line(f"refused as {code}: {count}")
    for fault in document["faults"]:
        output.line(f"FAULT: {fault}")
    if document["ok"]:
        output.line("none was taken, no process ended, and each answers the next valid call")
