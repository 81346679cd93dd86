"""Today's quadctl has all that a release had, and reads the files that it wrote."""

import json
import os
import shutil
import sqlite3
import tomllib
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest

import quadctl
from quadctl.cli.fleet import file as fleet_file
from quadctl.cli.lab.rubric import rubric
from quadctl.cli.mission.mission import mission
from quadctl.schemas.topics import TOPICS
from quadctl.schemas.typed import from_json
from quadctl.services.campaign.database import COLUMNS, Database
from quadctl.services.campaign.mission import Conditions
from quadctl.services.runtime.bus.session import free_port
from quadctl.services.runtime.params.load import load, read
from quadctl.services.runtime.params.names import flatten
from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.recording.verify import check
from tests.golden import data, digests, product, releases
from tests.support.lab import private_lab

VERSIONS = releases.releases()
everyone = pytest.mark.parametrize("version", VERSIONS)
MOST = 200_000
"""Bytes of a release's kept files together."""


def kept(version: str) -> Path:
    return releases.KEPT / version


def test_the_kept_files_are_small():
    for version in VERSIONS:
        assert sum(file.stat().st_size for file in kept(version).rglob("*")) < MOST


@everyone
@pytest.mark.parametrize("name", [name for name in releases.DOCUMENTS if name != "messages"])
def test_nothing_of_a_release_is_missing(version: str, name: str):
    found = releases.missing(version, name, data.read(name))
    assert not found, "\n".join(found)


@everyone
def test_readers_take_the_types_of_a_release(version: str):
    then, now = releases.document(version, "messages"), digests.forms()
    assert not (faults := digests.all_broken(then, now)), "\n".join(faults)
    for type_ in digests.sent():
        if type_.__name__ in then:
            ours = product.digests.DIGESTS[product.digests.place(type_)]
            assert then[type_.__name__]["hash"] in ours.split(".")
    assert then.keys() <= now.keys()


NUMBER = {"name": "x", "type": "float64", "bounds": "[0, 1]"}
SWITCH = {"name": "on", "type": "bool", "default": False}
MORE = {"name": "more", "type": "string", "default": ""}


def form(*fields: dict[str, Any], strict: bool = False, omits: bool = False) -> dict[str, Any]:
    """Return the description of a type with these fields."""
    return {"forbid_unknown_fields": strict, "omit_defaults": omits, "fields": [*fields]}


@pytest.mark.parametrize(
    ("then", "now", "alone", "follows"),
    [
        (form(NUMBER), form(NUMBER), True, True),
        (form(NUMBER), form(NUMBER, SWITCH, MORE), True, True),
        (form(NUMBER), form(NUMBER, SWITCH), False, True),
        (form(NUMBER, strict=True), form(NUMBER, SWITCH, strict=True, omits=True), True, True),
        (form(SWITCH), form(SWITCH | {"default": True}), True, False),
        (form(NUMBER), form(SWITCH, NUMBER), True, False),
        (form(NUMBER, SWITCH), form(NUMBER), True, False),
        (form(NUMBER), form(NUMBER | {"name": "y"}), True, False),
        (form(NUMBER), form(NUMBER | {"type": "int64"}), True, False),
        (form(NUMBER), form(NUMBER | {"bounds": "[0, 2]"}), True, False),
        (form(MORE), form(MORE | {"bounds": "a|b"}), True, False),
        (form(NUMBER), form(NUMBER, NUMBER | {"name": "y"}), True, False),
        (form(NUMBER), form(NUMBER, strict=True), True, False),
        (form(SWITCH), form(SWITCH, omits=True), True, False),
        (form(NUMBER, strict=True), form(NUMBER, SWITCH, strict=True), True, False),
        (form(NUMBER, strict=True), form(NUMBER, SWITCH, strict=True, omits=True), False, False),
    ],
)
def test_a_type_follows_another_if_it_has_gained_fields_with_defaults(
    then: dict[str, Any], now: dict[str, Any], *, alone: bool, follows: bool
):
    faults = releases.broken("T", {"T": then}, {"T": now}, sent_alone=alone)
    assert (faults == []) is follows, faults


def test_a_parameter_may_gain_a_choice_and_lose_none():
    kind = {"name": "kind", "type": "string", "unit": "", "bounds": "off|stuck"}
    then, longer, other = (
        releases.promised("parameters", {"parameters": [kind | {"bounds": bounds}]})
        for bounds in ("off|stuck", "off|stuck|wave", "off|wave")
    )
    assert not [*releases.lost(then, longer)]
    assert [*releases.lost(then, other)] == ["/kind/bounds: 'stuck' is missing"]


def test_what_is_lost_is_named_and_what_is_new_is_not():
    kept = {"a": [{"x": "number"}, "one"], "b": {"c": 1}}
    assert not [
        *releases.lost(kept, {"a": ["one", {"x": "number", "y": 1}], "b": {"c": 1, "d": 2}})
    ]
    assert [*releases.lost(kept, {"a": [{"y": "number"}], "b": {"c": 1.0}, "e": 1})] == [
        "/a: {'x': 'number'} is missing",
        "/a: 'one' is missing",
        "/b/c: was 1, now it is 1.0",
    ]
    assert [*releases.lost(kept, {"a": kept["a"]})] == ["/b: is missing"]


@everyone
def test_a_parameter_file_has_the_values_that_it_had(version: str):
    file = kept(version) / "quad.toml"
    values = dict(flatten(msgspec.to_builtins(load(file))))
    named = dict(flatten(tomllib.loads(file.read_text(encoding="utf-8"))))
    assert {name: values[name] for name in named} == named


@everyone
def test_missions_fleets_and_rubrics_are_read(version: str):
    folder = kept(version)
    assert mission(read(folder / "mission.toml"), "mission.toml").rows
    assert fleet_file.read(folder / "fleet.toml", "").members
    assert rubric(read(folder / "rubric.toml"), "rubric.toml").rows


@everyone
def test_a_recording_is_read_whole(version: str):
    file = kept(version) / "flight.mcap"
    assert check(file).faults == []
    columns = quadctl.read(file)["uav/pose"]
    assert columns["position"].shape == (len(columns["stamp"]), 3)
    types = {topic.key("uav"): topic.type for topic in TOPICS}
    seen = {m.key: m.decoded(types[m.key]) for m in Bag(file).messages() if m.key in types}
    assert {"uav/pose", "uav/safety/state", "uav/input/position"} <= seen.keys()


@everyone
def test_a_campaigns_database_is_read(version: str, tmp_path: Path):
    file = shutil.copy(kept(version) / "campaign.sqlite", tmp_path)
    with closing(sqlite3.connect(file)) as opened:
        conditions, probe = opened.execute("SELECT conditions, probe FROM campaign").fetchone()
        rows = opened.execute("SELECT * FROM flights")
        assert [about[0] for about in rows.description] == [*COLUMNS]
    with closing(Database(str(file), from_json(conditions, Conditions), probe)) as database:
        flown = [*database.flights(range(10_000_000))]
    assert [flight.seed for flight in flown] == [3_000_000, 3_000_001, 3_000_002]
    assert all(len(flight.hash) == 64 for flight in flown)


@everyone
def test_certificates_open_the_door(version: str):
    with private_lab() as lab:
        keys = lab.folder / "keys"
        shutil.copytree(kept(version) / "keys", keys)
        for file in keys.rglob("*.pem"):
            file.chmod(0o600)  # git keeps no mode
        names = {each["name"]: each for each in lab.quadctl("keys", "list", "--json").json}
        assert {name: names[name]["role"] for name in names} == {"hub": "hub", "anna": "operator"}
        at = f"tls/127.0.0.1:{free_port()}"
        lab.start("--listen", at, "--identity", keys / "hub")
        done = lab.quadctl("state", "--json", "--connect", at, "--identity", keys / "anna")
        assert (done.code, done.json["cage_on"]) == (0, True), done
        issued = lab.quadctl("keys", "issue", "observer", "ben", "--json")
        assert json.loads(issued.out)["role"] == "observer"
        assert os.access(keys / "ben" / "cert.pem", os.R_OK)
