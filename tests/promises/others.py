"""Strangers on the network, and many at once."""

from tests.promises.entry import Last, Promise

_ROOM = "30 students' machines and a teacher's on one network"

OTHERS = (
    Promise(
        "strangers on the network",
        "unasked, nothing listens; across machines both sides show certificates, and who is not"
        " allowed to is not",
        (
            "tests/security/test_network.py::test_a_default_up_listens_nowhere",
            "tests/security/test_certificates.py::test_strangers_are_kept_out",
            "tests/security/test_network.py::test_who_may_not_is_told_so_at_once",
            "tests/security/test_network.py::test_who_breaks_our_rules_meets_zenohs",
        ),
    ),
    Promise(
        "a certificate that is revoked",
        "gets nothing from 2 s after",
        (
            "tests/security/test_certificates.py::test_revoked_name_is_out_within_2_s_and_the_flight_goes_on",
            "tests/security/test_certificates.py::test_a_revoked_certificate_gets_nothing_after_two_seconds",
        ),
        (Last("a revoked certificate"),),
    ),
    Promise(
        "a classroom of runs on one machine",
        "none hears of another",
        (
            "tests/bus/test_many.py::test_three_realms_never_hear_of_one_another",
            "tests/bus/test_many.py::test_thirty_realms_for_a_minute",
        ),
        (Last("30 realms side by side"),),
    ),
    Promise(
        "thirty students on one network",
        "each flies his own and nobody else's; the teacher sees, stops and lands all; in flight nobody"
        " notices a cable that is out or a name that is revoked",
        (
            "tests/security/test_many_machines.py::test_the_page_as_it_stands",
            "tests/security/test_classroom.py::test_all_are_listed_and_their_poses_keep_their_rates",
            "tests/security/test_classroom.py::test_all_fly_at_the_same_time_each_to_a_goal_of_his_own",
            "tests/security/test_classroom.py::test_nobody_reaches_his_neighbours_vehicle",
            "tests/security/test_classroom.py::test_a_student_flies_his_own_and_touches_no_cage",
            "tests/security/test_classroom.py::test_the_teacher_stops_all_and_lands_all",
            "tests/security/test_classroom.py::test_a_cable_that_is_out_disturbs_nobody_else",
            "tests/security/test_classroom.py::test_who_is_revoked_is_out_and_the_others_are_undisturbed",
        ),
        (
            Last(f"{_ROOM}: until", "all listed"),
            Last(f"{_ROOM}: poses", "poses"),
            Last(f"{_ROOM}, each at", "at his neighbour's"),
            Last(
                f"{_ROOM}, their vehicles on the teacher's",
                "the vehicles on the teacher's machine: at his neighbour's",
            ),
            Last(f"{_ROOM}, in flight", "told to hold, hovering; landed"),
            Last(
                f"{_ROOM}, the cable",
                "of another's poses, one cable out, then ten: longest gap at home, at the teacher's;"
                " heard again",
            ),
            Last(
                f"{_ROOM}, one revoked",
                "until his last message; another's longest gap at the teacher's, at home",
            ),
        ),
    ),
    Promise(
        "a thousand vehicles on one hub",
        "no message is lost",
        (
            "tests/bus/test_many.py::test_the_telemetry_of_fifty_vehicles",
            "tests/bus/test_many.py::test_the_telemetry_of_a_thousand_vehicles",
        ),
        (Last("telemetry of 1000 vehicles"),),
    ),
)
