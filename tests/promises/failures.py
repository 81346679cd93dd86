"""Processes that die, freeze or linger, links that fail, disks that fill up."""

from tests.promises.entry import Last, Promise

FAILURES = (
    Promise(
        "a process of the system does not run for a while",
        "the vehicle brakes within 300 ms of silence. Within `dynamics.grace` (1 s) the flight goes on by"
        " itself, and says that it paused; after more it is over, and says why. Never out of the cage",
        (
            "tests/flight/test_stalls.py::test_sixty_flights_among_short_stalls",
            "tests/flight/test_stalls.py::test_an_outage_beyond_the_grace_ends_the_flight",
            "tests/flight/test_stalls.py::test_a_stall_within_the_grace_pauses_the_flight",
            "tests/unit/safety/test_monitor.py::test_what_happens_in_a_pause_ends_the_flight",
            "tests/flight/test_stalls.py::test_a_thousand_flights_among_short_stalls",
            "tests/flight/test_stalls.py::test_a_hundred_outages_beyond_the_grace",
        ),
        (
            Last("1000 flights, a process or all stopped for 0.1 to 0.5 s every 2 s", "short"),
            Last("100 flights with an outage of 2 s", "2 s"),
        ),
    ),
    Promise(
        "dynamics dies",
        "HOVERING within 300 ms, and the reason said; no goal is taken before there are poses again,"
        " and the new boot drops the old goal",
        (
            "tests/flight/test_kills.py::test_five_kills",
            "tests/unit/safety/test_monitor.py::test_lost_poses_pause_the_flight_and_no_goal_is_taken",
            "tests/unit/safety/test_monitor.py::test_a_new_boot_drops_the_goal_says_so_and_takes_off_anew",
            "tests/flight/test_kills.py::test_a_hundred_kills",
        ),
        (Last("`kill -9` of dynamics in flight"),),
    ),
    Promise(
        "dynamics freezes",
        "the same, by the age of the pose",
        (
            "tests/flight/test_kills.py::test_a_freeze",
            "tests/flight/test_kills.py::test_a_hundred_freezes",
        ),
        (Last("SIGSTOP of dynamics in flight"),),
    ),
    Promise(
        "setpoints stop: safety or the hub dies",
        "the vehicle brakes to a hover within 300 ms after a setpoint is 150 ms old. A new safety"
        " hovers there, cage on, and flies for a new request alone",
        (
            "tests/flight/test_kills.py::test_five_kills",
            "tests/unit/safety/test_monitor.py::test_after_a_restart_it_hovers_in_place_with_the_cage_on",
            "tests/flight/test_kills.py::test_a_hundred_kills",
        ),
        (
            Last("`kill -9` of safety in flight", "safety"),
            Last("`kill -9` of hub in flight", "hub"),
        ),
    ),
    Promise(
        "setpoints stop: safety or the hub freezes, the link between them is cut",
        "the same",
        (
            "tests/flight/test_kills.py::test_a_freeze",
            "tests/flight/test_stalls.py::test_safety_that_was_held_up_stops_the_flight_and_says_why",
            "tests/flight/test_stalls.py::test_setpoints_to_a_goal_given_up_by_a_stop_are_ignored",
            "tests/bus/test_links.py::test_vehicle_hovers_while_safety_is_cut_off_then_recovers",
            "tests/flight/test_kills.py::test_a_hundred_freezes",
            "tests/bus/test_links.py::test_cuts_of_five_seconds_again_and_again",
        ),
        (
            Last("SIGSTOP of safety in flight", "safety"),
            Last("SIGSTOP of hub in flight", "hub"),
            Last("200 ms each way and cuts of 5 s between safety and hub", "cut"),
        ),
    ),
    Promise(
        "somebody is missing, dead or frozen",
        "every command ends by its timeout and 0.2 s, exit 3 or 4, and says who it is",
        (
            "tests/cli/test_exit_codes.py::test_where_nothing_runs_every_command_exits_3_and_says_so",
            "tests/cli/test_frozen.py::test_every_command_is_in_a_table",
            "tests/cli/test_frozen.py::test_at_once",
            "tests/cli/test_frozen.py::test_when_the_hub_has_lost_it",
            "tests/cli/test_frozen.py::test_in_mid_stream",
            "tests/cli/test_frozen.py::test_of_what_ends_processes",
        ),
        tuple(
            Last(f"commands with {who} frozen", who)
            for who in ("nobody", "up", "hub", "dynamics", "pressure", "safety")
        ),
    ),
    Promise(
        "processes that ignore SIGTERM",
        "asked to end, then killed; of starts and stops nothing is left",
        (
            "tests/supervisor/test_endings.py::test_a_signal_ends_a_foreground_run_and_all_of_it",
            "tests/supervisor/test_endings.py::test_starts_and_stops_leave_nothing_behind",
            "tests/supervisor/test_endings.py::test_a_hundred_starts_and_stops_leave_nothing_behind",
        ),
        (Last("100 starts and stops"),),
    ),
    Promise(
        "Ctrl-C at any moment",
        "`up` ends all that it has started within 5 s, also in the middle of its launch; `goto` stops"
        " waiting and says that the flight goes on",
        (
            "tests/supervisor/test_moments.py::test_ctrl_c_at_any_moment_of_a_launch",
            "tests/supervisor/test_moments.py::test_goto_stops_waiting_and_the_flight_goes_on",
            "tests/supervisor/test_moments.py::test_ctrl_c_at_two_hundred_moments",
        ),
        (Last("Ctrl-C at 200 random moments"),),
    ),
    Promise(
        "the disk fills up while recording",
        "the recording stops and says so; the flight does not notice",
        (
            "tests/recording/test_record.py::test_a_full_disk_stops_the_recording_and_never_the_flight",
            "tests/supervisor/test_full_disk.py::test_a_run_goes_on_when_its_recording_finds_no_room",
            "tests/unit/runtime/recording/test_writer.py::test_a_full_device_is_told",
        ),
    ),
    Promise(
        "a viewer that is slow or stands still",
        "it loses what is oldest; nobody else misses anything, and safety answers as soon as ever",
        (
            "tests/bus/test_links.py::test_a_stalled_viewer_gets_the_newest_and_holds_up_nobody",
            "tests/bus/test_slow_readers.py::test_no_answer_to_a_pose_is_missed_beside_a_stalled_viewer",
            "tests/bus/test_slow_readers.py::test_and_it_comes_as_soon",
        ),
        (Last("a viewer of all keys that stands still"),),
    ),
)
