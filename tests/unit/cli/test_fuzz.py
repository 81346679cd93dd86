"""Payloads of `fuzz`: reproducible, of every kind, and always invalid."""

import random
from itertools import islice
from typing import Any

import msgspec
import pytest
from msgspec import Struct

from quadctl.cli.fuzz import HostilePayload, refused
from quadctl.schemas.services import GotoRequest, HoldRequest, SetParamsRequest
from quadctl.schemas.topics import MESSAGES, SERVICES, get_params, set_params
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid

TYPES = [
    *MESSAGES.values(),
    *(service.request for service in (*SERVICES, get_params("a"), set_params("a"))),
]


@pytest.mark.parametrize("type_", TYPES, ids=lambda t: t.__name__)
def test_every_payload_is_rejected(type_: type[Struct]):
    for payload in islice(refused(type_, random.Random(1)), 300):
        with pytest.raises(Invalid):
            _read(type_, payload)


def test_the_seed_determines_the_payloads():
    def some(seed: int) -> list[Any]:
        return list(islice(refused(GotoRequest, random.Random(seed)), 50))

    assert some(3) == some(3)
    assert some(3) != some(4)


def test_payloads_are_of_many_kinds():
    payloads = list(islice(refused(GotoRequest, random.Random(0)), 500))
    reasons = set()
    for payload in payloads:
        try:
            codec.decode(GotoRequest, payload.data, payload.encoding)
        except Invalid as problem:
            reasons.add(problem.message[:40])
    assert len(reasons) >= 10
    assert any(payload.attachment for payload in payloads)
    assert not any(
        p.attachment for p in islice(refused(GotoRequest, random.Random(0), called=False), 99)
    )
    decoded = [_fields(payload.data) for payload in payloads]
    assert any(fields.get("x") != fields.get("x") for fields in decoded), "NaN"
    assert any(fields.get("y") in {float("inf"), float("-inf")} for fields in decoded)


def test_a_type_without_fields_gets_payloads_too():
    assert len(list(islice(refused(HoldRequest, random.Random(0)), 100))) == 100
    assert len(list(islice(refused(SetParamsRequest, random.Random(0)), 100))) == 100


def _read(type_: type[Struct], payload: HostilePayload) -> None:
    codec.decode(type_, payload.data, payload.encoding)
    codec.decode_call(payload.attachment)


def _fields(data: bytes) -> dict[str, Any]:
    try:
        found = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return {}
    values = found if isinstance(found, dict) else {}
    return {name: value for name, value in values.items() if isinstance(value, float)}
