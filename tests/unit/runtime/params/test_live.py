"""Live parameters of a node: changes are atomic and saved first."""

from typing import Any

import msgspec
import pytest

from quadctl.schemas.params import FIXED_AT_LAUNCH, Params
from quadctl.schemas.services import GetParamsRequest, SetParamsRequest, SetParamsResponse
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.live import LiveParams
from quadctl.services.runtime.params.names import flatten

ACCEPTED = SetParamsResponse(True, "")


class Bench:
    """Live parameters of one node, with a list of saves and changes in order."""

    def __init__(self, node: str = "safety") -> None:
        self.params = Params()
        self.events: list[tuple[str, Any]] = []
        self.live = LiveParams(node, self.params, self._save, self._changed)

    def _save(self, table: Any) -> None:
        self.events.append(("saved", table.get("takeoff")))
        self.events.append(("then", self.params.safety.takeoff))

    def _changed(self) -> None:
        self.events.append(("changed", self.params.safety.takeoff))

    def get(self, *names: str) -> dict[str, Any]:
        return self.live.get(GetParamsRequest(list(names))).values

    def set(self, **values: Any) -> SetParamsResponse:
        dotted = {name.replace("__", "."): value for name, value in values.items()}
        return self.live.set(SetParamsRequest(dotted))

    def refuses(self, *parts: str, **values: Any) -> None:
        before = msgspec.to_builtins(self.params)
        reply = self.set(**values)
        assert not reply.success
        assert all(text in reply.reason for text in parts), reply.reason
        assert msgspec.to_builtins(self.params) == before
        assert self.events == []


def test_one_value_a_table_or_all_can_be_read():
    bench = Bench()
    assert bench.get("safety.virtual_cage.x") == {"safety.virtual_cage.x": 5.0}
    assert bench.get("/safety/virtual_cage/x") == {"safety.virtual_cage.x": 5.0}
    cage = {f"safety.virtual_cage.{axis}": 5.0 for axis in "xyz"}
    assert bench.get("safety.virtual_cage") == cage
    assert bench.get("safety.takeoff", "safety.virtual_cage") == cage | {"safety.takeoff": 1.0}
    whole = dict(flatten(msgspec.to_builtins(Params().safety), "safety"))
    assert bench.get() == bench.get("safety") == whole


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("safety.virtual_cage.w", "did you mean safety.virtual_cage."),
        ("safety.virtual_cag", ""),
        ("safety.takeof", "did you mean safety.takeoff?"),
        ("pressure.rate", ""),
    ],
)
def test_an_unknown_name_gets_the_nearest_as_a_hint(name: str, hint: str):
    with pytest.raises(Invalid, match=f"safety has no parameter {name}") as caught:
        Bench().get("safety.takeoff", name)
    assert caught.value.hint.startswith(hint)


def test_a_change_is_saved_then_applied_then_reported():
    bench = Bench()
    assert bench.set(safety__takeoff=2) == ACCEPTED
    assert bench.events == [("saved", 2.0), ("then", 1.0), ("changed", 2.0)]
    assert bench.get("safety.takeoff") == {"safety.takeoff": 2.0}


def test_a_held_table_shows_the_change():
    bench = Bench()
    cage, safety = bench.params.safety.virtual_cage, bench.params.safety
    values = {"/safety/virtual_cage/x": 3, "safety.takeoff": 2}
    assert bench.live.set(SetParamsRequest(values)) == ACCEPTED
    assert (cage.x, cage.y, cage.z) == (3.0, 5.0, 5.0)
    assert safety.takeoff == 2.0
    assert bench.params.safety is safety
    assert safety.virtual_cage is cage


def test_other_values_are_kept():
    bench = Bench()
    bench.set(safety__virtual_cage__x=3)
    bench.set(safety__virtual_cage__y=4)
    cage = bench.params.safety.virtual_cage
    assert (cage.x, cage.y, cage.z) == (3.0, 4.0, 5.0)


def test_one_bad_value_prevents_the_whole_change():
    Bench().refuses("safety.virtual_cage.x", safety__takeoff=2, safety__virtual_cage__x=-3)


@pytest.mark.parametrize(
    ("values", "parts"),
    [
        ({"safety__takeoff": "high"}, "safety.takeoff: expected `float`"),
        ({"safety__takeoff": float("nan")}, "safety.takeoff"),
        ({"safety__takeoff": float("inf")}, "safety.takeoff"),
        ({"safety__takeof": 2}, "did you mean safety.takeoff?"),
        ({"safety__takeoff__x": 2}, "safety.takeoff is a value and has no x"),
        ({"safety": 2}, "expected `object`"),
        ({"pressure__rate": 2}, "pressure.rate is not a parameter of safety"),
        ({"nonsense": 2}, "nonsense is not a parameter of safety"),
    ],
)
def test_a_bad_change_is_refused_with_its_name(values: dict[str, Any], parts: str):
    Bench().refuses(parts, **values)


@pytest.mark.parametrize("name", sorted(FIXED_AT_LAUNCH))
def test_a_fixed_parameter_is_refused_with_a_hint(name: str):
    bench = Bench(name.partition(".")[0])
    value = bench.get(name)[name]
    parts = (f"{name} is fixed at launch", f"quadctl up --set {name}=")
    bench.refuses(*parts, **{name.replace(".", "__"): value})


def test_the_cage_is_not_switched_by_a_parameter():
    Bench().refuses("fixed at launch", "`quadctl cage on`", safety__cage_on=True)
    Bench().refuses("fixed at launch", "`quadctl cage off`", safety__cage_on=False)


def test_rules_between_values_apply_to_live_changes():
    Bench("dynamics").refuses("1000 / rate", dynamics__rate=30)


def test_a_failed_save_changes_nothing():
    params = Params()

    def full(_table: Any) -> None:
        raise OSError(28, "No space left on device")

    live = LiveParams("safety", params, full, lambda: pytest.fail("a failed change was reported"))
    with pytest.raises(OSError, match="No space"):
        live.set(SetParamsRequest({"safety.takeoff": 2.0}))
    assert params == Params()


def test_a_users_own_node_has_no_parameters():
    bench = Bench("mine")
    assert bench.get() == {}
    bench.refuses("unknown parameter mine", mine__rate=2)
    bench.refuses("safety.takeoff is not a parameter of mine", safety__takeoff=2)


def test_a_partial_table_changes_only_its_fields():
    params = Params()
    live = LiveParams("safety", params, lambda table: None, lambda: None)
    params.safety.virtual_cage.z = 2.0
    assert live.set(SetParamsRequest({"safety.virtual_cage": {"x": 3.0}})).success
    cage = params.safety.virtual_cage
    assert (cage.x, cage.y, cage.z) == (3.0, 5.0, 2.0)


def test_a_fixed_parameter_inside_a_table_is_refused():
    live = LiveParams("dynamics", Params(), lambda table: None, lambda: None)
    reply = live.set(SetParamsRequest({"dynamics": {"speed": 3.0}}))
    assert not reply.success
    assert "fixed at launch" in reply.reason
