"""Keys, types, bytes, commands, parameters and names equal the recorded ones, in the same order."""

from typing import Any

import msgspec
import pytest

from tests.golden import data, product
from tests.golden.contract import DOCUMENTS
from tests.golden.differences import differences

ENCODED, MESSAGES = data.read("encoded"), data.read("messages")


@pytest.mark.parametrize("name", DOCUMENTS)
def test_the_contract_is_as_recorded(name: str):
    found = differences(data.read(name), data.plain(DOCUMENTS[name]()))
    assert not found, "\n".join([f"data/{name}.json:", *found, data.HOW])


@pytest.mark.parametrize("name", ENCODED["types"])
def test_recorded_bytes_are_decoded_and_encoded_again(name: str):
    type_, recorded = product.wire_types()[name], ENCODED["types"][name]
    payload = bytes.fromhex(recorded["hex"])
    read = msgspec.msgpack.decode(payload, type=type_)
    assert read == msgspec.convert(recorded["value"], type_)
    assert product.encode(read) == payload
    for encoding in (MESSAGES[name]["encoding"], "application/msgpack"):
        assert product.decode(type_, payload, encoding) == read
    assert msgspec.msgpack.decode(payload) == recorded["value"], (
        "the payload is a map with the names of the fields"
    )


@pytest.mark.parametrize(
    "recorded", ENCODED["attachments"], ids=lambda each: each["value"]["id"][:1]
)
def test_a_recorded_attachment_is_read(recorded: dict[str, Any]):
    call = product.decode_call(bytes.fromhex(recorded["hex"]))
    assert msgspec.to_builtins(call) == recorded["value"]


@pytest.mark.parametrize("code", ENCODED["errors"])
def test_a_recorded_error_reply_is_read(code: str):
    error = product.decode_error(ENCODED["errors"][code].encode())
    assert (error.code, error.message, error.hint) == (code, f"what {code}", "a hint")


def test_a_reader_names_both_hashes_of_an_unknown_schema():
    pose = product.wire_types()["Pose"]
    payload = bytes.fromhex(ENCODED["types"]["Pose"]["hex"])
    known = MESSAGES["Pose"]["encoding"]
    assert product.decode(pose, payload, known) == product.decode(pose, payload, "")
    other = known.partition("#")[0] + "#00000000"
    with pytest.raises(product.QuadctlError) as refused:
        product.decode(pose, payload, other)
    assert other.rpartition(".")[2] in refused.value.message
    assert known.rpartition(".")[2] in refused.value.message
