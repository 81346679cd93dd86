"""A user's own services, found and called by their liveliness tokens; and unknown names."""

import json
from collections.abc import Callable

import pytest
import zenoh

from tests.support.bare import Bare, pack, unpack
from tests.support.lab import Lab

KEY = "uav/@srv/mine/blink"
TOKEN = "uav/@node/mine/@srv/Blink/12345678/0/uav%@srv%mine%blink"
Serve = Callable[[zenoh.Query], None]


def blink(query: zenoh.Query) -> None:
    """Echo the request in its own encoding; refuse a request without `times`."""
    with query:
        assert query.payload is not None
        form, data = str(query.encoding), query.payload.to_bytes()
        asked = json.loads(data) if form == "application/json" else unpack(data)
        if "times" not in asked:
            query.reply_err("times, please", encoding="text/plain")
        else:
            said = {"did": asked["times"], "form": form}
            query.reply(
                query.key_expr,
                json.dumps(said) if form == "application/json" else pack(said),
                encoding=form,
            )


@pytest.fixture
def users_service(bare: Bare) -> None:
    bare._declared += [
        bare.session.declare_queryable(KEY, blink, complete=True),
        bare.session.declare_queryable("uav/@srv/unannounced", blink, complete=True),
        bare.session.liveliness().declare_token(TOKEN),
    ]


def test_a_users_service_is_listed_shown_and_called(shared_lab: Lab, users_service: None):
    done = shared_lab.each(
        [
            "service list",
            "service info mine/blink",
            "service info /uav/@srv/mine/blink --json",
            "service call mine/blink times=3",
            f"service call {KEY} times=3 --as json --json",
            "service call uav/@srv/unannounced times=1",
            "service call mine/blink",
            "service call mine/blink times=3 --as yaml",
        ]
    )
    listed, shown, document, called, as_json, unannounced, refused, formless = done.values()
    assert "mine/blink" in listed.out
    assert shown.out.splitlines()[:3] == [
        "Node:   mine",
        f"Key:    {KEY}",
        "Type:   Blink",
    ]
    assert document.json == {
        "name": "mine/blink", "key": KEY, "type": "Blink", "node": "mine", "hash": "12345678",
        "definition": "",
    }  # fmt: skip
    assert called == (0, "did: 3\nform: 'application/msgpack'\n", "")
    assert as_json.json == {"did": 3, "form": "application/json"}
    assert unannounced.code == 0
    assert refused.code == 1
    assert refused.err.startswith(f"error: {KEY} failed: times, please\n")
    assert formless.code == 2


def test_a_type_before_the_request_is_ignored(shared_lab: Lab, users_service: None):
    spellings = ("Blink '{times: 3}'", "quad/Blink times=3", "my_own/srv/Blink 'times: 3'")
    done = shared_lab.each([f"service call /mine/blink {spelling}" for spelling in spellings])
    assert {ended.out.splitlines()[0] for ended in done.values()} == {"did: 3"}
    alone = shared_lab.quadctl("service", "call", KEY, "std_srvs/srv/Trigger")
    assert alone.err.startswith(f"error: {KEY} failed: times, please\n")


@pytest.mark.thorough
def test_an_unknown_name_is_answered_with_the_nearest_live_one(
    shared_lab: Lab, users_service: None
):
    done = shared_lab.each(
        [
            "service info mine/blnk",
            "service call mine/blnk times=3",
            "service call uav/@srv/mine/blnk --timeout 0.2",
            "service call uav/@srv/*/blink",
        ]
    )
    codes = [ended.code for ended in done.values()]
    hints = [ended.err.splitlines()[-1].strip() for ended in done.values()]
    assert codes == [6, 6, 3, 6]
    assert hints == [
        "try: did you mean mine/blink?",
        "try: did you mean mine/blink?",
        "try: did you mean mine/blink?",
        "try: `quadctl service list` shows the keys",
    ]
