"""Promises against each hazard, with the tests that hold them and the figures of long counts.

Each entry of the text below has, in this order:

- the hazard, and below it the promise;
- `-`: the tests of one file, without `tests/` and `test_`; everyday tests come first;
- `=`: a figure of the long counts, by words that only the name of its proof contains. If an
  entry has several, each has its label and `<-` before it.

A line indented by four spaces continues the previous line.

Over 500 lines: it is one list, and a page of the documentation.
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
  - cli/exit_codes: impossible_commands_fail_with_their_exit_codes
  - unit/safety/monitor: a_goal_that_is_not_finite_is_refused_even_with_the_cage_off
  - bus/fuzz: fuzzed_payloads_are_refused_and_end_no_process
    a_hundred_thousand_fuzzed_payloads_end_no_process
  = fuzzed payloads on every service and topic
a goal during the flight to another goal
  rejected as busy, exit 5; with `--replace` verified and flown
  - unit/safety/automaton: each_rule_does_what_its_case_expects
    no_mutant_of_the_rule_table_passes_all_cases
  - flight/checkpoint_2: a_goal_while_moving_is_busy_until_replaced
the cage comes on in flight
  the goal is verified again; if it is outside, the vehicle stops and hovers; the reply comes
  after that
  - unit/safety/automaton: never_moving_with_the_cage_on_and_the_goal_outside
  - flight/checkpoint_4: turning_the_cage_on_stops_a_flight_to_a_goal_outside
    turning_the_cage_on_keeps_a_flight_to_a_goal_inside
the cage comes on with the vehicle outside
  the vehicle hovers where it is and accepts only goals inside; on its way back every step comes
  nearer
  - unit/safety/monitor_guards: outside_any_face_the_vehicle_hovers_and_accepts_only_goals_inside
  - unit/campaign/batch: a_vehicle_outside_hovers_accepts_goals_inside_and_returns
  - flight/checkpoint_4: a_goal_outside_is_refused_then_reached_with_the_cage_off
the cage shrinks at run time
  as if it came on: with the goal outside the vehicle stops; a vehicle outside hovers and accepts
  only goals inside
  - flight/parameters: a_smaller_cage_takes_effect_at_once
    a_vehicle_outside_a_shrunk_cage_hovers_and_may_return
  - unit/safety/monitor: a_cage_that_excludes_the_goal_stops_the_flight
a cage that comes on or shrinks around a healthy vehicle
  the guard of the path does not stop the vehicle, in flight or hovering: it already does all that
  is possible
  - unit/campaign/batch: enabling_or_shrinking_the_cage_raises_no_alarm
  - flight/checkpoint_4: turning_the_cage_on_keeps_a_flight_to_a_goal_inside
  - flight/campaign: ten_thousand_flights_stay_within_the_margin
  = false alarms of the guard of the way in 10 000 flights
the cage or a zone changes in a turn
  at most 10 mm farther outside what is then in force than a vehicle that gets `hold` in that instant
  - unit/safety/changes: a_cage_around_the_new_goal_of_a_turn_leads_no_farther_out_than_a_hold
    changes_in_random_flights_lead_no_farther_out_than_a_hold
    100_000_changes_lead_no_farther_out_than_a_hold
  - flight/checkpoint_4: turning_the_cage_on_keeps_a_flight_to_a_goal_inside
  = changes of cage or zones
goals inside, replaced in flight
  at most 10 mm out of the cage in still air, for any goals at any time; a goal that the vehicle
  cannot stop at is passed as far as by a stop, an older one never; a landing ends on the floor
  - flight/fly: goals_on_the_walls_replaced_in_flight_keep_path_and_vehicle_inside
  - unit/dynamics/vehicle_goals: 2000_flights_of_replaced_goals_stay_inside
  - unit/dynamics/trajectory: moved_goals_are_not_overshot_beyond_the_farthest
  - unit/dynamics/vehicle_goals: a_landing_lands_whatever_came_before_it
    50_000_flights_of_replaced_goals 100_000_landings
  - flight/campaign: a_search_finds_no_way_out_of_twelve_cages
  = replaced <- 50 000 flights of replaced goals
  = landings <- 100 000 landings
  = search <- a search of 100 000 flights
body, gains or limits set in flight
  they take effect at the next standstill, and `param set` reports this; at most 10 mm out of the
  cage. A vehicle that is unstable or cannot hold itself is refused, at launch and live, exit 6
  - flight/parameters_in_flight: no_value_set_in_flight_takes_the_vehicle_out_of_the_cage
  - flight/parameters: a_limit_set_in_flight_is_reported_as_waiting
    a_vehicle_that_would_not_fly_is_refused
  - unit/campaign/bodies: a_parameter_set_in_flight_keeps_it_inside_or_is_refused
a body and gains anywhere near one that was flown
  a table of ranges, a factor of 2 for a body and 1.5 for gains, outside of which they are refused, exit 6, or
  flown without a promise if the file says so. Inside, the vehicle stays within the margin in force,
  10 mm in still air, and its stops in the space that it reserves, out of zones and apart from others; motors
  that a fault weakens are outside of it
  - flight/parameters: a_vehicle_that_would_not_fly_is_refused
  - supervisor/unproven: a_body_far_from_all_that_were_flown_flies_with_a_warning_if_the_file_says_so
  - unit/campaign/bodies: a_body_that_a_search_led_out_has_no_promise
    random_bodies_of_the_table_stay_within_the_margin_in_force
    soft_bodies_of_the_table_stay_in_their_boxes_out_of_zones_and_apart
    a_search_of_100_000_flights_over_the_table_stays_within_the_margin_in_force
    searches_of_100_000_flights_of_soft_bodies_keep_what_they_reserve
  = still air <- over the table of what may fly, still air
  = wind <- over the table of what may fly, wind
  = stops <- soft bodies of the table, stops
  = zones <- soft bodies of the table, flights among zones
  = changes <- soft bodies of the table, changes
  = pairs <- soft bodies of the table, flights of pairs
limits or a wind beyond the body
  limits beyond the body are flown with what it can do, at most 10 mm out of the cage in still air, and
  `param set` reports this; a body that cannot fly is refused. In a wind beyond it the vehicle stops and
  lands, and follows no goal until the wind is less
  - unit/campaign/bodies: limits_beyond_the_body_keep_300_flights_inside
    a_body_flies_inside_or_is_refused
  - unit/dynamics/simulation: a_vehicle_that_cannot_hold_itself_lands_until_it_can
  - flight/parameters: a_wind_beyond_the_envelope_lands_the_vehicle
    limits_beyond_the_body_are_accepted_and_told
the path to a goal leaves the cage
  the whole path is inside, also that of the setpoint; from outside it only leads towards the cage
  - flight/fly: goals_on_the_walls_replaced_in_flight_keep_path_and_vehicle_inside
  - unit/safety/automaton: never_moving_with_the_cage_on_and_the_path_outside
  - unit/dynamics/trajectory: the_setpoint_stays_inside_for_any_sequence_of_goals
  - unit/safety/monitor_guards: a_return_from_outside_may_not_move_outwards
the vehicle overshoots a wall
  never more than 1 cm beyond the cage in still air, in wind within the declared margin; a vehicle
  put outside by command never passes its stopping point of that instant
  - flight/fly: goals_on_the_walls_replaced_in_flight_keep_path_and_vehicle_inside
  - unit/campaign/batch: flights_have_no_violation a_broken_rule_is_detected
  - flight/campaign: ten_thousand_flights_stay_within_the_margin
  = still air <- 10 000 flights of 60 s in still air
  = wind and faults <- 10 000 flights of 60 s in wind
  - flight/campaign: a_search_in_wind_finds_no_way_beyond_the_margin
  = search in wind <- a search of 10 000 flights
a campaign that others cannot repeat
  the same SHA-256 however many processes, machines or interruptions; its memory does not grow
  - flight/campaign: a_campaign_is_independent_of_the_number_of_processes
    a_killed_campaign_continues_from_its_database the_memory_does_not_grow_with_the_flights
  - flight/campaign_cluster: workers_that_die_or_differ_leave_the_report_the_same
    20_000_flights_have_one_hash_however_they_are_flown
  = one hash <- 20 000 flights: different hashes
  = memory <- memory of a campaign of 100 000 flights
a fault in safety itself
  the campaign, which judges each decision a second time, detects 17 of 17 broken versions
  - flight/campaign: a_violation_exits_8_and_prints_the_command_to_replay_it
  - unit/campaign/broken_safety: the_campaign_detects_a_broken_safety
    the_campaign_finds_no_fault_in_the_sound_safety
a sequence of events that no test tries
  an induction over the rule table, checked by an SMT solver: after any events, nothing is MOVING to
  a goal outside with the cage on, no setpoint is outside except to brake, every stop ends, and only a
  goal accepted with a pose, or a flight resumed with one, sends the vehicle off
  - flight/storms: a_storm_of_stops_never_moves_the_vehicle_out
  - unit/safety/proof: every_event_keeps_the_invariants
    every_call_of_the_monitor_keeps_the_invariants the_proof_fails_on_a_broken_automaton
    the_proof_fails_on_a_broken_monitor
  = obligations of the proof about safety
a zone that the straight way crosses
  flown around, leg by leg, or refused with --direct; a change of course in flight is refused where its
  curve could touch a zone; one added in flight stops a vehicle whose way it bars
  - unit/safety/way: a_zone_in_the_way_is_flown_around_as_one_request
    a_direct_way_is_refused_and_changes_nothing in_flight_a_change_of_course_near_a_zone_is_refused
    a_zone_added_in_flight_holds_at_once random_flights_never_enter_a_zone
    a_leg_that_begins_near_the_floor_bends
    10_000_random_flights_among_random_zones_enter_none a_search_of_100_000_flights_enters_no_zone
  - unit/airspace/zones: a_million_decisions_about_zones_agree_with_shapely
    a_boundary_belongs_to_the_allowed_side
  - flight/zones: zones_of_the_file_bar_ways_and_the_vehicle_flies_around_them
  = greatest depth in a zone
  = decisions about zones
another vehicle on the way, or one that flies there
  refused with its name, or with --wait held until it has passed; `fleet goto` finds an order and points
  between, or moves nobody; a vehicle off its course is stopped, and so is the one that it comes near
  - unit/safety/separation: a_goal_past_another_vehicle_is_refused_with_its_name
    a_way_is_reserved_until_it_has_been_flown a_goal_waits_until_its_way_is_free
    two_that_would_wait_for_each_other_are_told_so a_vehicle_pushed_towards_another_stops_both
    a_reset_onto_the_way_of_another_stops_that_one random_flights_in_a_small_box_keep_apart
    a_way_that_begins_near_the_floor_bends
    a_vehicle_inside_the_space_of_one_that_stops_waits_until_it_rests
    10_000_flights_of_ten_in_a_small_box_keep_apart
  - unit/cli/fleet/plan: without_room_the_refusal_names_who_is_in_whose_way the_real_vehicles_fly_a_plan
    random_plans_are_flown_or_refused_before_anybody_moves
    10_000_random_plans_are_flown_or_refused_before_anybody_moves
  - flight/separation: three_change_places_by_one_command
    three_change_places_while_they_take_off fifty_change_places_by_one_command
    goals_too_near_each_other_move_nobody hold_drops_a_goal_that_waits
  = least distance <- least distance of two
  = plans <- random plans of
a goal that waits, and its vehicle or one ahead of it fails
  it ends with a reason and is never flown later: with the poses or a fault of its vehicle, or after 30 s in
  which nobody ahead of it moves on; nobody waits behind it
  - unit/safety/separation: a_goal_that_waits_ends_with_the_poses_of_its_vehicle
    a_goal_that_waits_ends_with_a_fault_of_its_vehicle
    a_goal_that_waits_ends_when_nobody_ahead_of_it_moves_on
    in_fleets_with_faults_no_goal_that_waits_hangs_and_all_land_or_are_told_why
    10_000_fleets_with_faults_hang_nowhere
  - flight/separation: hold_drops_a_goal_that_waits
  = goals that wait
an autopilot that is not ours in the place of the vehicle, over a bad radio
  flown only while its pilot has armed it and selected the mode of programs; what is lost in flight stops
  it, and what safety wanted before is dropped; it stays within what its calibration declares
  - mavlink/autopilot: the_pilot_takes_over_and_gives_back a_node_that_is_lost_in_flight_stops_it
    a_link_that_is_lost_stops_it through_a_bad_radio_it_stays_within_what_is_declared
    100_flights_through_a_bad_radio_stay_within_what_is_declared
  - unit/mavlink/adapter: poses_come_only_while_it_is_armed_and_follows_programs
    it_flies_only_with_the_fence without_positions_no_place_is_sent
  = 100 flights of an autopilot
a client of a bridge that floods, sends garbage, reads nothing or only begins; a bridge or a node that is killed
  the flight goes on; stops are executed and the newest goal is flown, others are served, and the bridge grows by
  at most 16 MB. While safety is silent poses are shown, and an order fails with the reason. All is served again
  by itself, with the next process of the bridge too
  - bridges/every_bridge: orders_are_carried_out_as_they_were_sent garbage_by_the_thousand_changes_nothing
    a_flood_of_goals_delays_no_stop_and_the_newest_is_flown
    while_safety_is_silent_poses_come_and_orders_fail_with_the_reason
    a_read_that_waits_for_a_silent_node_delays_no_order
    a_killed_bridge_leaves_the_flight_alone_and_the_next_one_serves
    a_bridge_goes_on_by_itself_when_a_killed_node_is_back a_client_that_reads_nothing_delays_no_other
    a_thousand_that_only_begin_keep_nobody_out the_flight_is_the_same_whatever_happens_to_the_bridge
a client of a bridge that may not act, or not all
  without the token or key it watches, and changes nothing; a bridge has the rights of its certificate
  - bridges/every_bridge: a_client_without_the_token_or_key_may_only_watch
    a_bridge_has_the_rights_of_its_certificate
a goal on the wall itself
  accepted: the wall belongs to the cage, to the last bit
  - unit/airspace/cage: a_face_is_inside_the_cage_to_the_last_bit
  - flight/checkpoint_2: a_goal_on_the_boundary_is_inside_the_cage
a cage too small to hold the vehicle
  less than 0.2 m is refused: in a file, on the command line, in flight
  - supervisor/bad_files: a_faulty_file_starts_nothing_and_the_error_names_the_place
  - flight/parameters: a_bad_value_changes_nothing_even_beside_good_ones
the first goal, or the start, lies outside the cage
  verified like any other: the vehicle stays on the ground, and safety gives the reason
  - unit/safety/monitor: a_takeoff_outside_the_cage_is_refused_with_its_reason
  - flight/checkpoint_4: a_takeoff_above_the_cage_leaves_the_vehicle_on_the_ground
a pose that is old, out of order, or a jump
  an old pose is ignored by its stamp; a pose that could only be reached above the top speed stops
  the flight
  - unit/safety/monitor: an_old_or_reordered_pose_is_ignored
  - unit/safety/monitor_guards: a_pose_that_jumps_stops_the_vehicle
  - flight/faults: a_bad_pose_stops_a_flight_with_its_reason
the wall clock jumps
  nothing in flight depends on it: after an hour forward or back the flight continues, and calls are
  answered
  - flight/wall_clock: nodes_fly_on_when_their_clock_jumps_by_an_hour
    flight_code_never_reads_the_time_of_day all_processes_and_zenoh_fly_on_when_the_clock_jumps
  = the wall clock set an hour on and back
a process of the system does not run for a while
  the vehicle brakes within 300 ms of silence. Within `dynamics.grace` (1 s) the flight continues by
  itself and reports the pause; after a longer silence it ends with a reason. Never out of the cage
  - flight/stalls: sixty_flights_arrive_despite_short_stalls
    an_outage_beyond_the_grace_ends_the_flight a_stall_within_the_grace_pauses_the_flight
  - unit/safety/monitor: a_change_during_a_pause_ends_the_flight
  - flight/stalls: a_thousand_flights_arrive_despite_short_stalls
    a_hundred_outages_beyond_the_grace_end_the_flights
  = short <- 1000 flights, a process or all stopped for 0.1 to 0.5 s every 2 s
  = 2 s <- 100 flights with an outage of 2 s
all processes stand still again and again, at random
  the vehicle never leaves the cage; the run heals by itself, and no process stays stopped
  - flight/storms: a_storm_of_stops_never_moves_the_vehicle_out
    a_long_storm_of_stops_never_moves_the_vehicle_out
  = all processes stopped at random
a recording or TOML file made to do harm
  refused or read in little memory, exit 6 or 8; no file is changed or left half-written
  - unit/cli/bombs: a_recording_made_to_do_harm_is_refused_or_read
    a_refused_recording_is_not_repaired_in_place
  - recording/replay: a_recording_made_to_do_harm_is_not_replayed
  - unit/runtime/params/load: a_bad_file_is_refused_with_the_place_and_a_hint
a recording with damaged bytes, one that is still being written, or that is removed meanwhile
  all but the damaged chunks is read, and what is lost is counted and reported; a repair never leaves less
  than there was, and refuses a file that is in use; the recorder reports that its file is gone
  - recording/record: a_recording_in_use_is_not_repaired_and_a_removed_one_is_reported
  - unit/runtime/recording/damage: all_but_a_damaged_chunk_is_read_and_what_is_lost_is_counted
    what_is_in_sound_chunks_is_read_wherever_bytes_are_damaged a_repair_keeps_link_owner_and_mode
  - unit/cli/bag: every_reader_skips_a_damaged_chunk_and_reports_it
another user of the machine gets to the temporary folder first
  every command refuses a link or a folder of another user in place of the run's, exit 2
  - security/temporary_folder: a_link_to_the_users_own_files_is_refused
    a_folder_of_another_user_is_refused
a watcher of the console sends events of its own
  nothing changes, whatever the socket sends
  - cli/console: a_watching_socket_controls_nothing_and_breaks_nothing
few open files, no shared memory, no IPv6, a full disk in the realm's folder
  flights arrive; a value that cannot be kept is not changed
  - supervisor/few_files: a_flight_arrives_while_strangers_take_all_files_of_the_hub
    more_keys_than_open_files_are_exported
  - supervisor/poor_machines: a_flight_needs_neither_shared_memory_nor_ipv6
    a_run_whose_folder_fills_up_flies_on_and_keeps_its_values
a certificate expires in flight
  its links end in that second, and no flight does; a new one of the hub opens the gate again
  - security/certificates: certificates_that_expire_in_flight_end_links_and_no_flight
dynamics dies
  HOVERING within 300 ms, with a reason; no goal is accepted until poses come again, and the new
  boot drops the old goal
  - flight/kills: a_killed_node_restarts_and_the_vehicle_stays_in_the_cage
  - unit/safety/monitor: lost_poses_pause_the_flight_and_goals_are_refused
    a_new_boot_drops_the_goal_and_takes_off_again
  - flight/kills: the_vehicle_brakes_in_time_after_a_hundred_kills
  = `kill -9` of dynamics in flight
dynamics freezes
  the same, detected by the age of the pose
  - flight/kills: a_frozen_node_restarts_and_the_vehicle_stays_in_the_cage
    the_vehicle_brakes_in_time_after_a_hundred_freezes
  = SIGSTOP of dynamics in flight
setpoints stop: safety or the hub dies
  the vehicle brakes to a hover within 300 ms after a setpoint is 150 ms old. A new safety process
  hovers there with the cage on, and flies only after a new request
  - flight/kills: a_killed_node_restarts_and_the_vehicle_stays_in_the_cage
  - unit/safety/monitor: after_a_restart_the_vehicle_hovers_with_the_cage_on
  - flight/kills: the_vehicle_brakes_in_time_after_a_hundred_kills
  = safety <- `kill -9` of safety in flight
  = hub <- `kill -9` of hub in flight
setpoints stop: safety or the hub freezes, or the link between them is cut
  the same
  - flight/kills: a_frozen_node_restarts_and_the_vehicle_stays_in_the_cage
  - flight/stalls: a_stall_of_safety_itself_stops_the_flight_with_a_reason
    setpoints_to_an_abandoned_goal_are_ignored
  - bus/links: the_vehicle_hovers_while_safety_is_cut_off_then_recovers
  - flight/kills: the_vehicle_brakes_in_time_after_a_hundred_freezes
  - bus/links: the_system_recovers_from_repeated_cuts_of_five_seconds
  = safety <- SIGSTOP of safety in flight
  = hub <- SIGSTOP of hub in flight
  = cut <- 200 ms each way and cuts of 5 s between safety and hub
a process is missing, dead or frozen
  every command ends within its timeout plus 0.2 s, exit 3 or 4, and names the process
  - unit/cli/offline: without_a_run_the_exit_code_is_3_and_no_file_is_written
  - cli/transcripts: commands_without_a_run_name_the_next_step
  - cli/frozen: every_command_is_in_a_table commands_end_in_time_right_after_a_freeze
    commands_end_in_time_after_the_hub_dropped_a_process
    a_stream_ends_in_time_when_a_process_freezes commands_that_end_processes_work_with_one_frozen
  = none <- commands with nobody frozen
  = up <- commands with up frozen
  = hub <- commands with hub frozen
  = dynamics <- commands with dynamics frozen
  = pressure <- commands with pressure frozen
  = safety <- commands with safety frozen
processes that ignore SIGTERM
  after SIGTERM they get SIGKILL; starts and stops leave nothing behind
  - supervisor/endings: a_signal_ends_a_foreground_run_and_all_its_processes
    starts_and_stops_leave_nothing_behind a_hundred_starts_and_stops_leave_nothing_behind
  = 100 starts and stops
Ctrl-C at any moment
  `up` ends everything that it has started within 5 s, also in the middle of its launch; `goto` stops
  waiting and reports that the flight continues
  - supervisor/moments: ctrl_c_at_any_moment_of_a_launch_leaves_nothing_behind
    ctrl_c_ends_a_waiting_goto_and_the_flight_goes_on
    ctrl_c_at_two_hundred_moments_leaves_nothing_behind
  = Ctrl-C at 200 random moments
a recording that goes on for hours, pages that nobody reads
  the memory of the recorder and of the console stays the same; SIGTERM ends the console
  - unit/runtime/recording/writer: a_long_recording_takes_no_more_memory
    an_hour_of_recording_takes_constant_memory
  - cli/console: pages_that_do_not_read_are_limited_and_end_with_it
  = growth in an hour <- a recording of an hour
strangers at the door: half-open connections by the thousand
  they keep out nobody with a certificate, and sessions that are there do not notice
  - security/door: half_open_connections_keep_nobody_out the_door_is_open_for_ipv6
    a_thousand_strangers_for_a_minute_delay_nobody
  = 1000 half-open connections
a client that declares very much, and leaves
  a name may declare a limited number, of short keys; others' messages are not delayed
  - unit/gate/wire: each_declaration_counts_until_it_is_withdrawn
    no_declaration_hides_in_an_extension a_number_stands_for_one_declaration
  - security/door: a_client_with_too_many_declarations_is_sent_away
    a_key_that_would_fill_the_hubs_memory_gets_no_further_than_the_door
    who_leaves_delays_no_pose_by_50_ms
  = a client leaves with all
many vehicles start on a busy machine
  the start has as long as it makes progress, and says how far it is
  - supervisor/vehicles: a_start_that_takes_long_says_how_far_it_is
    two_hundred_vehicles_start_at_a_load_of_ten
  - unit/runtime/supervisor/supervisor: the_time_to_be_ready_counts_from_the_last_progress
  = 200 vehicles beside ten busy processes <- vehicles 200`
a command is stopped with Ctrl-Z and continued
  it says so, and goes on
  - cli/topic: echo_that_was_stopped_says_so_and_goes_on
a text from the bus with control characters, or with ones that turn it round
  they are printed escaped
  - bus/bad_messages: control_characters_of_a_message_are_printed_escaped
  - unit/cli/output: terminal_control_characters_are_escaped
    invisible_characters_are_escaped_and_letters_stay
  - unit/cli/console/panels: markup_and_controls_in_a_reason_are_escaped
the disk fills up while recording
  the recording stops with a message; the flight is not affected
  - recording/record: a_full_disk_stops_the_recording_and_never_the_flight
  - supervisor/full_disk: a_run_goes_on_when_its_recording_has_no_space
  - unit/runtime/recording/writer: a_full_device_raises_an_error
a viewer that is slow or frozen
  it loses the oldest messages; no other process loses any, and safety answers as fast as before
  - bus/links: a_stalled_viewer_gets_the_newest_and_delays_no_one
  - bus/slow_readers: no_answer_to_a_pose_is_missed_beside_a_stalled_viewer
    answers_beside_a_stalled_viewer_are_not_later
  = a viewer of all keys that stands still
a command comes late or twice
  executed at most once, and never after its deadline
  - bus/calls: a_repeated_id_is_executed_once_and_answered_the_same
    a_call_past_its_deadline_expires_and_is_not_executed
    a_call_is_not_repeated_when_its_server_ends_in_mid_call
  - bus/links: a_cut_link_executes_no_call_twice_or_late
    the_system_recovers_from_repeated_cuts_of_five_seconds
  = 200 ms each way and cuts of 5 s between operator and hub
two operators at once
  one queue, one order; each reply belongs to its request
  - bus/operators: two_operators_share_one_queue two_operators_share_one_queue_for_a_thousand_gotos
  = two operators at once
a second safety process
  refuses to start, exit 7; of a hundred started together on a machine one remains
  - supervisor/endings: a_node_started_a_second_time_exits_7
  - supervisor/moments: one_of_many_safeties_stays one_of_a_hundred_safeties_stays
  = 100 safeties started
setpoints from another program
  `doctor` finds the second writer, announced or not; in the secure profile only safety's
  certificate may write them
  - cli/doctor: doctor_finds_a_second_publisher_of_setpoints
  - security/network: zenohs_access_control_stops_a_client_without_quadctl
the barometer is calibrated before its first reading
  `not_ready`, exit 5; the baseline does not change
  - unit/pressure/barometer: calibrating_without_a_sample_changes_nothing
  - flight/checkpoint_3: without_dynamics_nothing_is_calibrated_or_published
the barometer is calibrated in flight
  allowed; the spread of the samples shows the quality of the baseline
  - flight/barometer: a_calibration_while_climbing_has_a_larger_spread
the barometer is stuck, off, or shows values that air cannot have
  `doctor` reports it within its 2 s of listening; safety does not use the barometer
  - flight/barometer: doctor_reports_a_barometer_stuck_or_off_in_flight
  - unit/cli/doctor/bus: a_stuck_or_impossible_pressure_is_found
  - flight/barometer: a_garbled_file_ends_the_node_and_a_repaired_one_revives_it
a faulty parameter file
  nothing starts, exit 6, with the place and the nearest name
  - unit/runtime/params/load: at_least_forty_bad_files_are_covered
    a_bad_file_is_refused_with_the_place_and_a_hint
  - supervisor/bad_files: a_faulty_file_starts_nothing_and_the_error_names_the_place
another version's messages
  read if one version only adds fields with defaults to the other's, in both directions; else refused,
  with both hashes named; no message is decoded as another type
  - golden/versions: commands_work_with_the_other_version
    programs_work_with_the_other_version
    a_new_field_of_a_request_is_refused_where_it_is_unknown
    versions_that_do_not_fit_refuse_each_other
  - bus/calls: another_schema_is_refused_and_both_hashes_are_named
    a_message_of_another_schema_is_ignored
  - cli/transcripts: a_reply_of_another_version_is_refused
another version's files
  those of each release since 1.0 are read: recordings, parameters, missions, rubrics, certificates; a
  campaign's flights are continued by a version that flies the same, else refused unchanged
  - golden/releases: a_recording_is_read_whole a_campaigns_database_is_read
    certificates_open_the_door a_parameter_file_has_the_values_that_it_had
    nothing_of_a_release_is_missing
  - unit/campaign/database: flights_of_a_version_with_other_facts_are_refused_unchanged
strangers on the network
  by default nothing listens; between machines both sides show certificates, and a call without the
  right to it is denied
  - security/network: a_default_up_opens_no_listening_socket
  - security/certificates: clients_without_our_certificate_are_refused
  - security/network: a_denied_command_fails_at_once_with_the_reason
    zenohs_access_control_stops_a_client_without_quadctl
a certificate that is revoked
  receives nothing from 2 s after the revocation
  - security/certificates: a_revoked_name_is_out_and_the_flight_goes_on
    a_revoked_certificate_gets_nothing_after_two_seconds
  = a revoked certificate
a classroom of runs on one machine
  no run receives a message of another
  - bus/many: three_realms_receive_nothing_from_each_other
    thirty_realms_for_a_minute_receive_nothing_from_each_other
  = 30 realms side by side
thirty students on one network
  each student flies one vehicle and no other; the teacher sees, stops and lands all; an unplugged
  cable or a revoked name does not affect the flights of others
  - security/network: a_denied_command_fails_at_once_with_the_reason
  - security/many_machines: the_commands_of_the_page_print_the_shown_output
  - security/classroom: all_vehicles_are_listed_and_their_poses_keep_their_rates
    all_vehicles_fly_at_once_each_to_its_own_goal no_student_reaches_his_neighbours_vehicle
    a_student_flies_only_his_vehicle_and_toggles_no_cage the_teacher_stops_and_lands_all_vehicles
    an_unplugged_cable_disturbs_no_other_student
    a_revoked_student_is_out_and_the_others_are_undisturbed
    a_new_list_of_names_silences_nobody_for_long
  = longest gap at the teacher's after `keys issue`, `keys revoke`, a new vehicle's <- network, `keys issue`
  = all listed <- network: until
  = poses <- network: poses
  = calls to a neighbour's vehicle <- network, each at
  = the same with the vehicles on the teacher's machine <- network, their vehicles on the
    teacher's
  = all commanded to hold, all hovering; all landed <- network, in flight
  = longest gap in another's poses with one cable out, then ten: at home, at the teacher's; poses
    back after <- network, the cable
  = last message after; longest gap in another's poses at the teacher's, at home <- network, one revoked
a grade that depends on the load of the machine, or on luck
  a hand-in gets the same grade each time, and a mistake costs its own rows alone; a run that grades
  waits for a process that stands still
  - lab/lab: a_class_is_graded_each_for_itself
  - lab/evidence: a_crash_is_the_first_line_and_costs_the_rows_of_its_node_only
  - flight/fly: a_run_of_its_own_waits_for_a_frozen_process
  - bus/slow_readers: in_lockstep_no_message_of_a_node_of_ones_own_is_lost_to_a_slow_reader
  - lab/evidence: a_handler_that_blocks_is_named_and_waited_for_twice
  - lab/lab: right_hand_ins_in_each_style_have_full_marks_in_each_run
  - flight/fly: a_node_in_any_style_flies_the_same_mission a_loop_that_sleeps_answers_its_calls
  - lab/lab: the_rubric_tells_the_mistakes_apart_in_20_runs_of_20
  = Right hand-ins
  = The rubric tells
a rubric with a hole
  each single fault of a right solution loses a row, but for those that are listed as right as well
  - lab/trial: a_mutant_that_no_row_is_about_passes_and_is_named each_mutant_of_our_solutions_loses_a_row
  = Mutants of right solutions
a hand-in that cheats
  gains no point, and disturbs no other hand-in; it sees neither rubric nor solution
  - lab/lab: a_hand_in_sees_neither_rubric_nor_solution no_cheat_gains_a_point_or_disturbs_the_next
    a_hand_in_with_all_its_processes_leaves_a_neighbour_his
  = Cheats that gain
a thousand vehicles on one hub
  no message is lost
  - bus/many: no_telemetry_of_fifty_vehicles_is_lost no_telemetry_of_a_thousand_vehicles_is_lost
  = telemetry of 1000 vehicles
"""

PROMISES = tuple(map(_promise, re.split(r"\n(?! )", _TEXT.strip())))
