"""Promises against each hazard, with the tests that hold them and the figures of long counts.

Each entry of the text below has, in this order:

- the hazard, and below it the promise;
- `-`: the tests of one file, without `tests/` and `test_`; everyday tests come first;
- `=`: a figure of the long counts, by words that only the name of its proof contains. If an
  entry has several, each has its label and `<-` before it.

A line indented by four spaces continues the previous line.
"""

import re
from typing import NamedTuple


class Promise(NamedTuple):
    """Promise against one hazard; `tests` are node ids, `last` maps words of a proof to a label."""

    hazard: str
    promise: str
    tests: tuple[str, ...]
    last: dict[str, str]


def _promise(entry: str) -> Promise:
    hazard, *lines = re.sub(r"\n    ", " ", entry).splitlines()
    words = [line.strip() for line in lines]
    promise = " ".join(line for line in words if line[0] not in "-=")
    files = [line[2:].split(": ") for line in words if line[0] == "-"]
    tests = (
        f"tests/{'/test_'.join(file.rsplit('/', 1))}.py::test_{name}"
        for file, names in files
        for name in names.split()
    )
    figures = [line[2:].rpartition(" <- ") for line in words if line[0] == "="]
    return Promise(hazard, promise, tuple(tests), {proof: of for of, _, proof in figures})


_TEXT = """\
an invalid goal: NaN, infinite, of the wrong type
  refused by the command, by decoding and by the automaton; nothing changes, no process ends, the
  next valid call is answered
  - cli/exit_codes: commands_that_cannot_be_fail_by_their_codes
  - unit/safety/monitor: no_place_is_refused_even_with_the_cage_off
  - bus/fuzz: nothing_wrong_is_taken_and_nothing_ends nor_in_a_hundred_thousand
  = fuzzed payloads on every service and topic
a goal during the flight to another goal
  rejected as busy, exit 5; with `--replace` verified and flown
  - unit/safety/automaton: a_row_does_this no_mutant_of_the_table_survives
  - flight/checkpoint_2: a_goal_while_moving_is_busy_until_replaced
the cage comes on in flight
  the goal is verified again; if it is outside, the vehicle stops and hovers; the reply comes
  after that
  - unit/safety/automaton: never_moving_with_the_cage_on_and_the_goal_outside
  - flight/checkpoint_4: turned_on_in_flight_to_a_goal_outside_the_vehicle_stops
    turned_on_in_flight_to_a_goal_inside_the_flight_goes_on
the cage comes on with the vehicle outside
  the vehicle hovers where it is and accepts only goals inside; on its way back every step comes
  nearer
  - unit/safety/monitor_guards: outside_any_face_it_hovers_and_takes_only_goals_inside
  - unit/campaign/batch: outside_it_hovers_takes_goals_inside_and_comes_nearer
  - flight/checkpoint_4: refused_outside_then_reached_with_the_cage_off
the cage shrinks at run time
  as if it came on: with the goal outside the vehicle stops; a vehicle outside hovers and accepts
  only goals inside
  - flight/parameters: a_smaller_cage_holds_at_once
    vehicle_outside_a_shrunk_cage_hovers_and_may_come_back
  - unit/safety/monitor: a_cage_that_shuts_the_goal_out_under_way_stops
a cage that comes on or shrinks around a healthy vehicle
  the guard of the path does not stop the vehicle, in flight or hovering: it already does all that
  is possible
  - unit/campaign/batch: a_cage_that_comes_on_or_shrinks_is_no_alarm
  - flight/campaign: ten_thousand_flights
  = false alarms of the guard of the way in 10 000 flights
goals inside, replaced in flight
  at most 10 mm out of the cage in still air, for any goals at any time; the acceleration vector
  keeps its limit, so the vehicle may pass a goal moved nearer, but no older one
  - unit/dynamics/vehicle_goals: 2000_flights_of_replaced_goals
  - unit/dynamics/trajectory: goals_moved_in_flight_no_overshoot_of_the_farthest
  - unit/dynamics/vehicle_goals: 50_000_flights_of_replaced_goals
  = 50 000 flights of replaced goals
body, gains or limits set in flight
  they take effect at the next standstill, and `param set` reports this; at most 10 mm out of the
  cage. A vehicle that is unstable or cannot hold itself is refused, at launch and live, exit 6
  - flight/parameters: no_value_takes_it_out_of_the_cage what_is_set_in_flight_is_told_to_wait
    a_vehicle_that_would_not_fly_is_refused
the path to a goal leaves the cage
  the whole path is inside, also that of the setpoint; from outside it only leads towards the cage
  - unit/safety/automaton: never_moving_with_the_cage_on_and_the_way_outside
  - unit/dynamics/trajectory: the_setpoint_stays_inside_wherever_the_goal_moves
  - unit/safety/monitor_guards: the_way_back_comes_nearer_at_every_step
the vehicle overshoots a wall
  never more than 1 cm beyond the cage in still air, in wind within the declared margin; a vehicle
  put outside by command never passes its stopping point of that instant
  - unit/campaign/batch: no_flight_breaks_a_promise a_broken_automaton_is_found
  - flight/campaign: ten_thousand_flights
  = still air <- 10 000 flights of 60 s in still air
  = wind and faults <- 10 000 flights of 60 s in wind
a goal on the wall itself
  accepted: the wall belongs to the cage, to the last bit
  - unit/safety/cage: a_face_belongs_to_the_cage_to_the_last_bit
  - flight/checkpoint_2: the_boundary_belongs_to_the_cage
a cage too small to hold the vehicle
  less than 0.2 m is refused: in a file, on the command line, in flight
  - supervisor/bad_files: a_faulty_file_starts_nothing_and_says_where_it_is_wrong
  - flight/parameters: a_bad_value_changes_nothing_even_beside_good_ones
the first goal, or the start, lies outside the cage
  verified like any other: the vehicle stays on the ground, and safety gives the reason
  - unit/safety/monitor: takeoff_out_of_the_cage_is_refused_with_its_reason
  - flight/checkpoint_4: takeoff_above_the_cage_leaves_the_vehicle_on_the_ground
a pose that is old, out of order, or a jump
  an old pose is ignored by its stamp; a pose that could only be reached above the top speed stops
  the flight
  - unit/safety/monitor: an_old_or_reordered_pose_is_ignored
  - unit/safety/monitor_guards: a_pose_that_jumps_stops_the_vehicle
  - flight/faults: a_bad_pose_stops_a_flight_with_its_reason
the wall clock jumps
  nothing in flight depends on it: after an hour forward or back the flight continues, and calls are
  answered
  - flight/wall_clock: an_hour_on_and_back_in_flight what_flies_never_asks_for_the_time_of_day
    of_all_that_runs_zenoh_too
  = the wall clock set an hour on and back
a process of the system does not run for a while
  the vehicle brakes within 300 ms of silence. Within `dynamics.grace` (1 s) the flight continues by
  itself and reports the pause; after a longer silence it ends with a reason. Never out of the cage
  - flight/stalls: sixty_flights_among_short_stalls an_outage_beyond_the_grace_ends_the_flight
    a_stall_within_the_grace_pauses_the_flight
  - unit/safety/monitor: what_happens_in_a_pause_ends_the_flight
  - flight/stalls: a_thousand_flights_among_short_stalls a_hundred_outages_beyond_the_grace
  = short <- 1000 flights, a process or all stopped for 0.1 to 0.5 s every 2 s
  = 2 s <- 100 flights with an outage of 2 s
dynamics dies
  HOVERING within 300 ms, with a reason; no goal is accepted until poses come again, and the new
  boot drops the old goal
  - flight/kills: five_kills
  - unit/safety/monitor: lost_poses_pause_the_flight_and_no_goal_is_taken
    a_new_boot_drops_the_goal_says_so_and_takes_off_anew
  - flight/kills: a_hundred_kills
  = `kill -9` of dynamics in flight
dynamics freezes
  the same, detected by the age of the pose
  - flight/kills: a_freeze a_hundred_freezes
  = SIGSTOP of dynamics in flight
setpoints stop: safety or the hub dies
  the vehicle brakes to a hover within 300 ms after a setpoint is 150 ms old. A new safety process
  hovers there with the cage on, and flies only after a new request
  - flight/kills: five_kills
  - unit/safety/monitor: after_a_restart_it_hovers_in_place_with_the_cage_on
  - flight/kills: a_hundred_kills
  = safety <- `kill -9` of safety in flight
  = hub <- `kill -9` of hub in flight
setpoints stop: safety or the hub freezes, or the link between them is cut
  the same
  - flight/kills: a_freeze
  - flight/stalls: safety_that_was_held_up_stops_the_flight_and_says_why
    setpoints_to_a_goal_given_up_by_a_stop_are_ignored
  - bus/links: vehicle_hovers_while_safety_is_cut_off_then_recovers
  - flight/kills: a_hundred_freezes
  - bus/links: cuts_of_five_seconds_again_and_again
  = safety <- SIGSTOP of safety in flight
  = hub <- SIGSTOP of hub in flight
  = cut <- 200 ms each way and cuts of 5 s between safety and hub
a process is missing, dead or frozen
  every command ends within its timeout plus 0.2 s, exit 3 or 4, and names the process
  - cli/exit_codes: where_nothing_runs_every_command_exits_3_and_says_so
  - cli/frozen: every_command_is_in_a_table at_once when_the_hub_has_lost_it in_mid_stream
    of_what_ends_processes
  = none <- commands with nobody frozen
  = up <- commands with up frozen
  = hub <- commands with hub frozen
  = dynamics <- commands with dynamics frozen
  = pressure <- commands with pressure frozen
  = safety <- commands with safety frozen
processes that ignore SIGTERM
  they get SIGTERM, then SIGKILL; starts and stops leave nothing behind
  - supervisor/endings: a_signal_ends_a_foreground_run_and_all_of_it
    starts_and_stops_leave_nothing_behind a_hundred_starts_and_stops_leave_nothing_behind
  = 100 starts and stops
Ctrl-C at any moment
  `up` ends everything that it has started within 5 s, also in the middle of its launch; `goto` stops
  waiting and reports that the flight continues
  - supervisor/moments: ctrl_c_at_any_moment_of_a_launch goto_stops_waiting_and_the_flight_goes_on
    ctrl_c_at_two_hundred_moments
  = Ctrl-C at 200 random moments
the disk fills up while recording
  the recording stops with a message; the flight is not affected
  - recording/record: a_full_disk_stops_the_recording_and_never_the_flight
  - supervisor/full_disk: a_run_goes_on_when_its_recording_finds_no_room
  - unit/runtime/recording/writer: a_full_device_is_told
a viewer that is slow or frozen
  it loses the oldest messages; no other process loses any, and safety answers as fast as before
  - bus/links: a_stalled_viewer_gets_the_newest_and_holds_up_nobody
  - bus/slow_readers: no_answer_to_a_pose_is_missed_beside_a_stalled_viewer and_it_comes_as_soon
  = a viewer of all keys that stands still
a command comes late or twice
  executed at most once, and never after its deadline
  - bus/calls: the_same_id_is_executed_once_and_answered_alike
    past_its_deadline_a_call_is_expired_and_not_executed
    a_server_that_ended_in_mid_call_is_not_asked_again
  - bus/links: cut_link_executes_no_call_twice_or_late cuts_of_five_seconds_again_and_again
  = 200 ms each way and cuts of 5 s between operator and hub
two operators at once
  one queue, one order; each reply belongs to its request
  - bus/operators: two_operators_have_one_queue two_operators_and_a_thousand_gotos
  = two operators at once
a second safety process
  refuses to start, exit 7; of a hundred started together on a machine one remains
  - supervisor/endings: a_node_started_a_second_time_exits_7
  - supervisor/moments: of_many_safeties_one_stays of_a_hundred_safeties_one_stays
  = 100 safeties started
setpoints from another program
  `doctor` finds the second writer, announced or not; in the secure profile only safety's
  certificate may write them
  - cli/doctor: somebody_elses_setpoints_are_seen
  - security/network: who_breaks_our_rules_meets_zenohs
the barometer is calibrated before its first reading
  `not_ready`, exit 5; the baseline does not change
  - unit/pressure/barometer: calibrating_without_a_sample_changes_nothing
  - flight/checkpoint_3: without_dynamics_nothing_is_calibrated_or_published
the barometer is calibrated in flight
  allowed; the spread of the samples shows the quality of the baseline
  - flight/barometer: calibrated_in_flight_its_spread_says_so
the barometer is stuck, off, or shows values that air cannot have
  `doctor` reports it within its 2 s of listening; safety does not use the barometer
  - flight/barometer: doctor_sees_that_it_is_stuck_or_off_in_flight
  - unit/cli/doctor/bus: the_barometer
  - flight/barometer: garbled_file_ends_the_node_and_a_mended_file_revives_it
a faulty parameter file
  nothing starts, exit 6, with the place and the nearest name
  - unit/runtime/params/load: there_are_forty_of_them
    a_bad_file_is_refused_with_the_place_and_the_way_out
  - supervisor/bad_files: a_faulty_file_starts_nothing_and_says_where_it_is_wrong
another version's messages
  refused, with both hashes named; no message is decoded as another type
  - bus/calls: another_schema_is_refused_and_both_are_named a_topic_with_another_schema_is_not_taken
  - cli/transcripts: another_versions_reply_is_told_from_ours
strangers on the network
  by default nothing listens; between machines both sides show certificates, and a call without the
  right to it is denied
  - security/network: a_default_up_listens_nowhere
  - security/certificates: strangers_are_kept_out
  - security/network: who_may_not_is_told_so_at_once who_breaks_our_rules_meets_zenohs
a certificate that is revoked
  receives nothing from 2 s after the revocation
  - security/certificates: revoked_name_is_out_within_2_s_and_the_flight_goes_on
    a_revoked_certificate_gets_nothing_after_two_seconds
  = a revoked certificate
a classroom of runs on one machine
  no run receives a message of another
  - bus/many: three_realms_never_hear_of_one_another thirty_realms_for_a_minute
  = 30 realms side by side
thirty students on one network
  each student flies one vehicle and no other; the teacher sees, stops and lands all; an unplugged
  cable or a revoked name does not affect the flights of others
  - security/many_machines: the_page_as_it_stands
  - security/classroom: all_are_listed_and_their_poses_keep_their_rates
    all_fly_at_the_same_time_each_to_a_goal_of_his_own nobody_reaches_his_neighbours_vehicle
    a_student_flies_his_own_and_touches_no_cage the_teacher_stops_all_and_lands_all
    a_cable_that_is_out_disturbs_nobody_else who_is_revoked_is_out_and_the_others_are_undisturbed
  = all listed <- network: until
  = poses <- network: poses
  = calls to a neighbour's vehicle <- network, each at
  = the same with the vehicles on the teacher's machine <- network, their vehicles on the
    teacher's
  = all commanded to hold, all hovering; all landed <- network, in flight
  = longest gap in another's poses with one cable out, then ten: at home, at the teacher's; poses
    back after <- network, the cable
  = last message after; longest gap in another's poses at the teacher's, at home <- network, one revoked
a thousand vehicles on one hub
  no message is lost
  - bus/many: the_telemetry_of_fifty_vehicles the_telemetry_of_a_thousand_vehicles
  = telemetry of 1000 vehicles
"""

PROMISES = tuple(map(_promise, re.split(r"\n(?! )", _TEXT.strip())))
