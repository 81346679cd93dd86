"""Commands and who gives them, the barometer, parameters, and what another version says."""

from tests.promises.entry import Last, Promise

ORDERS = (
    Promise(
        "a command comes late or twice",
        "executed once at most, and never after its deadline",
        (
            "tests/bus/test_calls.py::test_the_same_id_is_executed_once_and_answered_alike",
            "tests/bus/test_calls.py::test_past_its_deadline_a_call_is_expired_and_not_executed",
            "tests/bus/test_calls.py::test_a_server_that_ended_in_mid_call_is_not_asked_again",
            "tests/bus/test_links.py::test_cut_link_executes_no_call_twice_or_late",
            "tests/bus/test_links.py::test_cuts_of_five_seconds_again_and_again",
        ),
        (Last("200 ms each way and cuts of 5 s between operator and hub"),),
    ),
    Promise(
        "two operators at once",
        "one queue, one order; each reply is that of its request",
        (
            "tests/bus/test_operators.py::test_two_operators_have_one_queue",
            "tests/bus/test_operators.py::test_two_operators_and_a_thousand_gotos",
        ),
        (Last("two operators at once"),),
    ),
    Promise(
        "a second safety process",
        "refuses to start, exit 7; of a hundred started together on a machine one stays",
        (
            "tests/supervisor/test_endings.py::test_a_node_started_a_second_time_exits_7",
            "tests/supervisor/test_moments.py::test_of_many_safeties_one_stays",
            "tests/supervisor/test_moments.py::test_of_a_hundred_safeties_one_stays",
        ),
        (Last("100 safeties started"),),
    ),
    Promise(
        "setpoints from somebody else",
        "`doctor` finds the second writer, announced or not; in the secure profile only safety's"
        " certificate may write them",
        (
            "tests/cli/test_doctor.py::test_somebody_elses_setpoints_are_seen",
            "tests/security/test_network.py::test_who_breaks_our_rules_meets_zenohs",
        ),
    ),
    Promise(
        "the barometer is calibrated before it has read anything",
        "`not_ready`, exit 5; the baseline stays",
        (
            "tests/unit/pressure/test_barometer.py::test_calibrating_without_a_sample_changes_nothing",
            "tests/flight/test_checkpoint_3.py::test_without_dynamics_nothing_is_calibrated_or_published",
        ),
    ),
    Promise(
        "it is calibrated in flight",
        "allowed; the spread of its samples tells how good that is",
        ("tests/flight/test_barometer.py::test_calibrated_in_flight_its_spread_says_so",),
    ),
    Promise(
        "it is stuck, off, or beyond what air can be",
        "`doctor` says so within its 2 s of listening; safety does not fly by it",
        (
            "tests/flight/test_barometer.py::test_doctor_sees_that_it_is_stuck_or_off_in_flight",
            "tests/unit/cli/doctor/test_bus.py::test_the_barometer",
            "tests/flight/test_barometer.py::test_garbled_file_ends_the_node_and_a_mended_file_revives_it",
        ),
    ),
    Promise(
        "a parameter file with a fault in it",
        "nothing starts, exit 6, with the place and the nearest name",
        (
            "tests/unit/runtime/params/test_load.py::test_there_are_forty_of_them",
            "tests/unit/runtime/params/test_load.py::test_a_bad_file_is_refused_with_the_place_and_the_way_out",
            "tests/supervisor/test_bad_files.py::test_a_faulty_file_starts_nothing_and_says_where_it_is_wrong",
        ),
    ),
    Promise(
        "another version's messages",
        "refused with both hashes named, nothing is decoded as something else",
        (
            "tests/bus/test_calls.py::test_another_schema_is_refused_and_both_are_named",
            "tests/bus/test_calls.py::test_a_topic_with_another_schema_is_not_taken",
            "tests/cli/test_transcripts.py::test_another_versions_reply_is_told_from_ours",
        ),
    ),
)
