"""Strangers on the network, and many at once."""

from tests.promises.entry import Last, Promise

OTHERS = (
    Promise(
        "strangers on the network",
        "unasked, nothing listens; across machines both sides show certificates, and who is not"
        " allowed to is not",
        (
            "tests/network/test_network.py::test_a_default_up_listens_nowhere",
            "tests/network/test_network.py::test_strangers_are_kept_out",
            "tests/network/test_network.py::test_who_may_not_is_told_so_at_once",
            "tests/network/test_network.py::test_who_breaks_our_rules_meets_zenohs",
        ),
    ),
    Promise(
        "a certificate that is revoked",
        "gets nothing from 2 s after",
        (
            "tests/network/test_network.py::test_a_revoked_name_is_out_within_two_seconds_and_the_flight_goes_on",
            "tests/network/test_revoked.py::test_a_revoked_certificate_gets_nothing_after_two_seconds",
        ),
        (Last("a revoked certificate"),),
    ),
    Promise(
        "a classroom of runs on one machine",
        "none hears of another",
        (
            "tests/processes/test_many.py::test_three_realms_never_hear_of_one_another",
            "tests/processes/test_many.py::test_thirty_realms_for_a_minute",
        ),
        (Last("30 realms side by side"),),
    ),
    Promise(
        "a thousand vehicles on one hub",
        "no message is lost",
        (
            "tests/processes/test_many.py::test_the_telemetry_of_fifty_vehicles",
            "tests/processes/test_many.py::test_the_telemetry_of_a_thousand_vehicles",
        ),
        (Last("telemetry of 1000 vehicles"),),
    ),
)
