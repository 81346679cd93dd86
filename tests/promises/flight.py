"""Goals and the cage: what the automaton lets the vehicle do."""

from tests.promises.entry import Last, Promise

FLIGHT = (
    Promise(
        "a goal that is no place: NaN, infinite, of the wrong type",
        "refused by the command, at decoding and in the automaton; nothing changes, no process ends,"
        " the next sound call is answered",
        (
            "tests/cli/test_exit_codes.py::test_commands_that_cannot_be_fail_by_their_codes",
            "tests/unit/safety/test_monitor.py::test_no_place_is_refused_even_with_the_cage_off",
            "tests/bus/test_fuzz.py::test_nothing_wrong_is_taken_and_nothing_ends",
            "tests/bus/test_fuzz.py::test_nor_in_a_hundred_thousand",
        ),
        (Last("fuzzed payloads on every service and topic"),),
    ),
    Promise(
        "a goal while another is being flown to",
        "answered as busy, exit 5; with `--replace` verified and flown",
        (
            "tests/unit/safety/test_automaton.py::test_a_row_does_this",
            "tests/unit/safety/test_automaton.py::test_no_mutant_of_the_table_survives",
            "tests/flight/test_checkpoint_2.py::test_a_goal_while_moving_is_busy_until_replaced",
        ),
    ),
    Promise(
        "the cage comes on in flight",
        "the goal is verified again, and with it outside the vehicle stops and hovers; the reply comes"
        " after that",
        (
            "tests/unit/safety/test_automaton.py::test_never_moving_with_the_cage_on_and_the_goal_outside",
            "tests/flight/test_checkpoint_4.py::test_turned_on_in_flight_to_a_goal_outside_the_vehicle_stops",
            "tests/flight/test_checkpoint_4.py::test_turned_on_in_flight_to_a_goal_inside_the_flight_goes_on",
        ),
    ),
    Promise(
        "the cage comes on with the vehicle outside",
        "it comes on; the vehicle hovers where it is, takes goals inside alone, and comes nearer at"
        " every step",
        (
            "tests/unit/safety/test_monitor_guards.py::test_outside_any_face_it_hovers_and_takes_only_goals_inside",
            "tests/unit/campaign/test_batch.py::test_outside_it_hovers_takes_goals_inside_and_comes_nearer",
            "tests/flight/test_checkpoint_4.py::test_refused_outside_then_reached_with_the_cage_off",
        ),
    ),
    Promise(
        "the cage shrinks at run time",
        "as if it came on: goal outside, stop; vehicle outside, hover, and goals inside alone",
        (
            "tests/flight/test_parameters.py::test_a_smaller_cage_holds_at_once",
            "tests/flight/test_parameters.py::test_vehicle_outside_a_shrunk_cage_hovers_and_may_come_back",
            "tests/unit/safety/test_monitor.py::test_a_cage_that_shuts_the_goal_out_under_way_stops",
        ),
    ),
    Promise(
        "a cage that comes on or shrinks around a sound vehicle",
        "the guard of the way does not stop it, in flight or hovering: it does what can be done",
        (
            "tests/unit/campaign/test_batch.py::test_a_cage_that_comes_on_or_shrinks_is_no_alarm",
            "tests/flight/test_campaign.py::test_ten_thousand_flights",
        ),
        (Last("false alarms of the guard of the way in 10 000 flights"),),
    ),
    Promise(
        "goals inside, replaced in flight",
        "at most 10 mm out of the cage in still air, whatever is replaced when; the vector of"
        " acceleration keeps its limit, so a goal moved nearer may be passed, an older one is not",
        (
            "tests/unit/dynamics/test_vehicle_goals.py::test_2000_flights_of_replaced_goals",
            "tests/unit/dynamics/test_trajectory.py::test_goals_moved_in_flight_no_overshoot_of_the_farthest",
            "tests/unit/dynamics/test_vehicle_goals.py::test_50_000_flights_of_replaced_goals",
        ),
        (Last("50 000 flights of replaced goals"),),
    ),
    Promise(
        "body, gains or limits set in flight",
        "they hold from the next standstill, and `param set` says so; at most 10 mm out of the cage."
        " What is unstable or cannot hold itself is refused, at launch and live, exit 6",
        (
            "tests/flight/test_parameters.py::test_no_value_takes_it_out_of_the_cage",
            "tests/flight/test_parameters.py::test_what_is_set_in_flight_is_told_to_wait",
            "tests/flight/test_parameters.py::test_a_vehicle_that_would_not_fly_is_refused",
        ),
    ),
    Promise(
        "the way there leaves the cage",
        "the whole way is inside, of the setpoint too; from outside it leads towards the cage alone",
        (
            "tests/unit/safety/test_automaton.py::test_never_moving_with_the_cage_on_and_the_way_outside",
            "tests/unit/dynamics/test_trajectory.py::test_the_setpoint_stays_inside_wherever_the_goal_moves",
            "tests/unit/safety/test_monitor_guards.py::test_the_way_back_comes_nearer_at_every_step",
        ),
    ),
    Promise(
        "the vehicle overshoots a wall",
        "never more than 1 cm beyond the cage in still air, in wind within the declared margin; put"
        " outside by command, never beyond its stopping point of that instant",
        (
            "tests/unit/campaign/test_batch.py::test_no_flight_breaks_a_promise",
            "tests/unit/campaign/test_batch.py::test_a_broken_automaton_is_found",
            "tests/flight/test_campaign.py::test_ten_thousand_flights",
        ),
        (
            Last("10 000 flights of 60 s in still air", "still air"),
            Last("10 000 flights of 60 s in wind", "wind and faults"),
        ),
    ),
    Promise(
        "a goal on the wall itself",
        "the wall belongs to the cage, decided to the last bit",
        (
            "tests/unit/safety/test_cage.py::test_a_face_belongs_to_the_cage_to_the_last_bit",
            "tests/flight/test_checkpoint_2.py::test_the_boundary_belongs_to_the_cage",
        ),
    ),
    Promise(
        "a cage too small to hold the vehicle",
        "less than 0.2 m is refused: in a file, on the command line, in flight",
        (
            "tests/supervisor/test_bad_files.py::test_a_faulty_file_starts_nothing_and_says_where_it_is_wrong",
            "tests/flight/test_parameters.py::test_a_bad_value_changes_nothing_even_beside_good_ones",
        ),
    ),
    Promise(
        "the first goal, or the start, lies outside the cage",
        "verified like any other: the vehicle stays on the ground, and safety says why",
        (
            "tests/unit/safety/test_monitor.py::test_takeoff_out_of_the_cage_is_refused_with_its_reason",
            "tests/flight/test_checkpoint_4.py::test_takeoff_above_the_cage_leaves_the_vehicle_on_the_ground",
        ),
    ),
    Promise(
        "a pose that is old, out of order, or a jump",
        "old ones are ignored by their stamp; one that would have taken more than the top speed stops"
        " the flight",
        (
            "tests/unit/safety/test_monitor.py::test_an_old_or_reordered_pose_is_ignored",
            "tests/unit/safety/test_monitor_guards.py::test_a_pose_that_jumps_stops_the_vehicle",
            "tests/flight/test_faults.py::test_a_bad_pose_stops_a_flight_with_its_reason",
        ),
    ),
    Promise(
        "the wall clock jumps",
        "nothing in flight goes by it: an hour on or back, and the flight goes on, calls are answered",
        (
            "tests/flight/test_wall_clock.py::test_an_hour_on_and_back_in_flight",
            "tests/flight/test_wall_clock.py::test_what_flies_never_asks_for_the_time_of_day",
            "tests/flight/test_wall_clock.py::test_of_all_that_runs_zenoh_too",
        ),
        (Last("the wall clock set an hour on and back"),),
    ),
)
