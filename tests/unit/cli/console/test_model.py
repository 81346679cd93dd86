"""State of the console, the frames sent to a page, and goals chosen by keys and clicks."""

from functools import partial

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.console.model import (
    NOTHING_SEEN,
    STEPS,
    TICK,
    Board,
    clicked,
    events_between,
    frame,
    link,
    point,
    stepped,
)
from quadctl.schemas.messages import CageSize, NearestWall, Position
from quadctl.schemas.zones import CircleParams, ZoneParams
from tests.support.console_messages import pose, reading, state

GOAL = Position(1, 2, 1)
OUTSIDE = "outside the cage: x = 9 is beyond [-5, 5]"


@pytest.mark.parametrize(
    ("before", "now", "expected"),
    [
        (None, state(reason=OUTSIDE), []),
        (state(), state(stamp=2.0), []),
        (state(), state(request=2, state="VERIFYING"), []),
        (state(request=2, state="VERIFYING"), state(request=2, state="MOVING", goal=GOAL),
         [("accepted", "to (1, 2, 1)")]),
        (state(request=2, state="VERIFYING"), state(request=2, reason=OUTSIDE),
         [("refused", OUTSIDE)]),
        (state(), state(request=2, reason=OUTSIDE), [("refused", OUTSIDE)]),
        (state(request=2, reason=OUTSIDE), state(request=3, reason=OUTSIDE),
         [("refused", OUTSIDE)]),
        (state(state="MOVING"), state(state="MOVING", request=2, reason="busy"),
         [("refused", "busy")]),
        (state(state="MOVING", goal=GOAL), state(goal=GOAL), [("arrived", "at (1, 2, 1)")]),
        (state(state="MOVING"), state(reason="hold: stopped on request"),
         [("stopped", "hold: stopped on request")]),
        (state(), state(cage_on=False), [("cage", "cage off")]),
        (state(state="MOVING", cage_on=False), state(reason="stopped, the goal"),
         [("cage", "cage on"), ("stopped", "stopped, the goal")]),
        (state(), state(cage=CageSize(3, 5, 2)),
         [("cage", "cage is now x [-3, 3], y [-5, 5], z [0, 2]")]),
        (state(state="MOVING"), state(boot="b", reason="a new boot"), [("boot", "a new boot")]),
    ],
)  # fmt: skip
def test_every_change_is_reported_once(before, now, expected):
    assert list(events_between(before, now)) == expected


def test_a_negative_zero_has_no_minus():
    assert point(Position(-0.0, -0.001, 1.234)) == "(0, 0, 1.23)"


def flying(ticks: int = 0) -> Board:
    board = Board("uav")
    board.update_state(state())
    for number in range(ticks):
        board.tick(pose(x=number, stamp=float(number)), reading(1000 + number))
    return board


def texts(board: Board, target: Position | None = None) -> dict[str, str]:
    return frame(board, NOTHING_SEEN, target)[0]["read"]


def test_a_page_receives_only_new_samples():
    board = flying(5)
    first, seen = frame(board, NOTHING_SEEN, None)
    assert first["fresh"]
    assert [sample[1] for sample in first["samples"]] == [0, 1, 2, 3, 4]
    assert frame(board, seen, None)[0]["samples"] == []
    board.tick(pose(x=7), None)
    [sample] = frame(board, seen, None)[0]["samples"]
    assert sample[1] == 7
    assert sample[4] is None, "no reading was published"


@given(st.lists(st.sampled_from(["tick", "boot", "sent", "sent and lost"]), max_size=60))
def test_a_lost_frame_loses_no_sample(events):
    board, seen, has, boot = flying(), NOTHING_SEEN, [], 0
    for event in [*events, "sent"]:
        if event in {"tick", "boot"}:
            boot += event == "boot"
            board.tick(pose(x=len(has), boot=f"{boot}"), None)
            continue
        content, after = frame(board, seen, None)
        if event == "sent":
            has = ([] if content["fresh"] else has) + content["samples"]
            seen = after
    assert has == [list(sample[1:]) for sample in board.samples]


def test_a_new_boot_starts_a_new_trail():
    board = flying(3)
    _, seen = frame(board, NOTHING_SEEN, None)
    board.tick(pose(boot="b"), None)
    content, _ = frame(board, seen, None)
    assert content["fresh"]
    assert len(content["samples"]) == 1


def test_one_minute_of_samples_is_kept():
    assert len(flying(700).samples) * TICK == pytest.approx(60)


def test_the_link_is_connecting_live_silent_or_lost():
    board = flying()
    assert link(board) == "connecting"
    assert not texts(board)["problem"]
    board.tick(pose(), None)
    assert link(board) == "live"
    for _ in range(15):
        board.tick(None, None)
    assert link(board) == "silent"
    assert "dynamics" in texts(board)["problem"]
    board.problem = "nothing is running"
    assert link(board) == "lost"
    assert texts(board)["problem"] == "nothing is running"


def test_a_page_can_be_opened_before_the_first_message():
    content, _ = frame(Board("uav"), NOTHING_SEEN, None)
    assert (content["link"], content["pose"], content["cage"]) == ("connecting", None, None)


def test_texts_show_units():
    board = flying()
    board.tick(pose(1, -2, 1.5), reading(1013.1234))
    read = texts(board, Position(2, 0, 1))
    assert (read["x"], read["y"], read["height"]) == ("1.00", "-2.00", "1.50 m")
    assert (read["pressure"], read["baseline"]) == ("1013.1234 hPa", "not calibrated")
    assert read["target"] == "(2, 0, 1): Enter sends"
    board.tick(pose(), reading(-3.1e-6, baseline=1013.1))
    read = texts(board)
    assert (read["pressure"], read["baseline"]) == ("-3.1e-06 hPa", "1013.1000 hPa")


def test_the_nearest_wall_and_the_leg_are_shown_where_there_are_any():
    board = flying()
    assert (texts(board)["nearest"], texts(board)["leg"]) == ("-", "")
    wall = NearestWall("to\u202ewer", 0.417, near=True)
    board.update_state(state(state="MOVING", leg=2, legs=3, nearest=wall))
    assert texts(board)["nearest"] == r"to\u202ewer, 0.42 m"
    assert texts(board)["leg"] == "leg 2 of 3"
    assert frame(board, NOTHING_SEEN, None)[0]["near"] is True


def test_zones_are_sent_once_to_each_page_and_after_each_change():
    board = flying()
    content, seen = frame(board, NOTHING_SEEN, None)
    assert content["zones"] == []
    corners = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    tower = ZoneParams("tower", polygon=corners, ceiling=3.0)
    pond = ZoneParams("pond", "inclusion", circle=CircleParams(1.0, 2.0, 0.5), floor=0.5)
    for _ in range(2):
        board.update_zones((tower, pond))
        content, after = frame(board, seen, None)
        assert content["zones"] == [
            {"name": "tower", "kind": "exclusion", "corners": corners, "circle": None,
             "floor": None, "ceiling": 3.0},
            {"name": "pond", "kind": "inclusion", "corners": (), "circle": (1.0, 2.0, 0.5),
             "floor": 0.5, "ceiling": None},
        ]  # fmt: skip
        assert frame(board, after, None) == (content | {"zones": None}, after)
    board.update_zones(())
    assert frame(board, after, None)[0]["zones"] == []
    assert frame(board, seen, None)[0]["zones"] == []


def test_a_refused_goal_is_kept_once_until_the_next_boot():
    board = flying()
    goals = [Position(x, 0, 1) for x in (9, 8, 9)]
    for goal in goals:
        board.refuse(goal)
    assert [goal.x for goal in board.refused] == [8, 9]
    board.update_state(state(boot="b"))
    assert not board.refused


def test_refused_waypoint_of_another_publisher_is_kept():
    board = flying()
    board.add_request(Position(9, 0, 1))
    board.update_state(state(request=2, reason="outside"))
    board.update_state(state(request=3, reason="outside"))
    assert list(board.refused) == [Position(9, 0, 1)]
    board.add_request(Position(1, 0, 1))
    board.update_state(state(request=4, state="MOVING"))
    board.update_state(state(request=5, reason="outside"))
    assert list(board.refused) == [Position(9, 0, 1)]


def test_steps_are_one_metre_from_the_goal_and_add_up():
    board = flying()
    board.update_state(state(goal=Position(1, 2, 1)))
    step = partial(stepped, board)
    assert step(None, "ArrowRight") == Position(2, 2, 1)
    assert step(step(None, "ArrowUp"), "PageDown") == Position(1, 3, 0)
    assert step(step(None, "ArrowLeft"), "ArrowRight") == Position(1, 2, 1)


def test_without_a_goal_steps_start_at_the_vehicle():
    board = Board("uav")
    assert stepped(board, None, "ArrowUp") is None
    board.tick(pose(1, 1, 1), None)
    assert stepped(board, None, "ArrowUp") == Position(1, 2, 1)


def test_every_key_steps_in_its_own_direction():
    assert len(set(STEPS.values())) == len(STEPS)
    assert all(abs(x) + abs(y) + abs(z) == 1 for x, y, z in STEPS.values())


def test_a_click_is_rounded_to_ten_centimetres():
    assert clicked(1.234, -0.04, 1.5) == Position(1.2, 0.0, 1.5)


def test_the_places_of_other_vehicles_are_sent_after_a_change():
    board, seen = Board("uav0"), NOTHING_SEEN
    sent = []
    for places in ((), (Position(1.0, 2.0, 3.0),), (Position(1.0, 2.0, 3.0),), ()):
        board.update_others(places)
        content, seen = frame(board, seen, None)
        sent.append(content["others"])
    assert sent == [[], [[1.0, 2.0, 3.0]], None, []]
