"""Which tests are long: `make test-long` plays them, `make test` all others; CI plays both.

They are studies, campaigns and fits from end to end, whole pages of docs, and more cases of what
`make test` shows with one. What a user relies on has a test that is not long.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

#: By reason and file: how the ids of long tests begin. A file with none is long as a whole.
LONG: Final[dict[str, dict[str, tuple[str, ...]]]] = {
    "a page of docs that plays campaigns and fits models": {
        "docs/test_docs.py": (
            "test_every_block_gives_its_printed_result[analyses.md]",
            "test_every_block_gives_its_printed_result[approach_angle.md]",
            "test_every_block_gives_its_printed_result[calibration.md]",
            "test_every_block_gives_its_printed_result[ci.md]",
            "test_every_block_gives_its_printed_result[controllers.md]",
            "test_every_block_gives_its_printed_result[devices.md]",
            "test_every_block_gives_its_printed_result[drivers.md]",
            "test_every_block_gives_its_printed_result[friction_laws.md]",
            "test_every_block_gives_its_printed_result[identification.md]",
            "test_every_block_gives_its_printed_result[import.md]",
            "test_every_block_gives_its_printed_result[lateral.md]",
            "test_every_block_gives_its_printed_result[models.md]",
            "test_every_block_gives_its_printed_result[plants.md]",
            "test_every_block_gives_its_printed_result[python.md]",
            "test_every_block_gives_its_printed_result[robot.md]",
            "test_every_block_gives_its_printed_result[recordings.md]",
            "test_every_block_gives_its_printed_result[remote.md]",
            "test_every_block_gives_its_printed_result[tutorial.md]",
            "test_every_block_gives_its_printed_result[validation.md]",
        ),
    },
    "end to end; its parts, or a smaller one, are tried by `make test`": {
        "docs/test_site.py": ("test_search_from_the_disk_finds_a_key",),
        "analyses/articulated/test_analysis.py": (
            "test_analysis_finds_what_the_plant_has",
            "test_analysis_keeps_every_rule",
            "test_difference_of_both_sides_is_named",
            "test_gradual_contacts_are_in_interval_of_mu_s",
            "test_marker_off_its_place_is_named",
            "test_wrong_constant_is_named",
        ),
        "analyses/articulated/test_random_robots.py": (),
        "analyses/lugre/test_posterior.py": ("test_credible_intervals_are_those_of_profiles",),
        "analysis/report/test_files.py": (),
        "analysis/test_front.py": (
            "test_identified_numbers_are_those_of_json",
            "test_report_never_overwrites_a_recording",
            "test_undetermined_parameter_has_reason_and_no_number",
            "test_unknown_parameter_names_those_there_are",
        ),
        "cli/test_design.py": ("test_designed_procedure_states_promise_and_passes_check",),
        "cli/test_measure.py": ("test_page_of_run_shows_measures",),
        "cli/test_doctor.py": (
            "test_doctor_output_fits_80_columns",
            "test_rig_simulated_in_process_is_watched_at_rest",
        ),
        "cli/test_examples.py": (
            "test_example_command_gives_the_described_result[rigd calibrate procedures/calibr",
            "test_example_command_gives_the_described_result[rigd export runs/*.mcap --to par",
            "test_example_command_gives_the_described_result[rigd identify FILE --compare]",
            "test_example_command_gives_the_described_result[rigd identify FILE --law lugre-4]",
            "test_example_command_gives_the_described_result[rigd identify identified.mcap --",
            "test_example_command_gives_the_described_result[rigd identify runs/<that run>.mcap]",
            "test_example_command_gives_the_described_result[rigd report FILE --output page.html]",
            "test_example_command_gives_the_described_result[rigd run procedures/constant_cur",
            "test_example_command_gives_the_described_result[rigd validate MODEL.json FILE]",
            "test_example_command_gives_the_described_result[rigd validate model.json FILE --",
            "test_example_command_gives_the_described_result[rigd validate model.json FILE --",
            "test_example_command_gives_the_described_result[rigd validate model.json runs/*v",
            "test_example_command_gives_the_described_result[rigd validate model.json validat",
        ),
        "cli/test_location.py": ("test_the_doctor_names_the_file_of_the_rig",),
        "daemon/serve/test_aside.py": (
            "test_identification_writes_its_report_beside_the_recording",
            "test_long_check_completes_in_worker",
        ),
        "procedure/test_on_plant.py": (
            "test_plays_to_the_end[lateral_sweep-overrides3]",
            "test_plays_to_the_end[recommended_identification-overrides2]",
            "test_plays_to_the_end[validation_masses-overrides4]",
        ),
        "system/test_angle_wire.py": ("test_the_shipped_campaign_at_the_wire",),
        "system/test_approach_angle.py": (
            "test_resumed_simulation_asks_no_set_up_again",
            "test_person_is_asked_again_and_typed_text_recorded",
            "test_platform_not_pushed_back_is_not_driven",
            "test_scale_never_at_rest_leaves_run_undriven",
            "test_the_same_seed_gives_the_same_bytes",
        ),
        "system/test_articulated.py": (
            "test_circles_have_the_radius_of_the_paper",
            "test_dry_run_and_report_know_the_robot",
        ),
        "system/test_calibrate.py": (
            "test_a_recording_that_calibrates_nothing_is_refused",
            "test_a_run_records_which_calibration_it_had",
            "test_another_instrument_blocks_the_run",
            "test_doctor_reports_remaining_days_of_calibration",
            "test_instrument_is_checked_with_devices_in_own_processes",
            "test_missing_file_blocks_only_runs_that_need_it",
            "test_optional_value_that_has_expired_blocks_the_run",
            "test_the_shipped_calibration_is_what_its_procedures_give",
            "test_the_shipped_scale_is_what_its_procedure_gives",
        ),
        "sim/wire/test_mechanism.py": ("test_real_drivers_turn_the_described_disk",),
        "system/test_card_wire.py": ("test_run_completes_over_the_served_card",),
        "system/test_faults.py": (
            "test_a_procedure_shows_a_fault_itself",
            "test_run_continues_marks_rows_and_ends",
        ),
        "system/test_friction_laws.py": (
            "test_compare_names_law_that_data_support",
            "test_law_that_does_not_fit_gives_exit_code",
            "test_options_that_do_not_go_together_are_refused[options2---compare: BIC needs t",
        ),
        "system/test_identify_command.py": (
            "test_identifiable_parameters_are_right[paperboard]",
            "test_identifiable_parameters_are_right[stone]",
            "test_interrupted_sweep_is_identified_from_what_is_complete",
            "test_robust_fit_agrees_where_there_are_no_outliers",
            "test_several_recordings_make_one_report_grouped_by_floor",
            "test_the_json_has_the_promised_shape[paperboard]",
            "test_the_json_has_the_promised_shape[stone]",
            "test_identifiable_parameters_hold_truth_others_are_marked[paperboard]",
            "test_identifiable_parameters_hold_truth_others_are_marked[stone]",
            "test_imported_campaign_gives_the_same_numbers",
        ),
        "system/test_identify_lateral.py": (),
        "system/test_panel.py": (),
        "system/test_remote.py": ("test_dry_run_elsewhere_is_same_as_here",),
        "system/test_run_command.py": (
            "test_dry_run_estimates_duration_within_5_percent",
            "test_same_seed_gives_same_bytes_another_does_not",
        ),
        "system/test_soak.py": (),
        "system/test_third_family.py": (
            "test_a_third_family_is_listed_and_checked",
            "test_third_family_recording_has_a_page",
        ),
        "system/test_validate_command.py": (
            "test_each_floor_is_tried_by_its_own_model",
            "test_recording_of_another_rig_is_refused",
            "test_recording_without_the_drive_is_refused",
        ),
    },
    "a fit or verdict beside those that `make test` tries": {
        "analyses/approach_angle/calibration/test_conformance.py": (),
        "analyses/approach_angle/recorded/test_campaign.py": (
            "test_another_calibration_replays_the_raw_volts",
            "test_bad_run_is_in_json_terminal_and_report[ended early]",
            "test_bad_run_is_in_json_terminal_and_report[never driven]",
            "test_bad_run_is_in_json_terminal_and_report[no pre-trigger]",
            "test_bad_run_is_in_json_terminal_and_report[pot at its end]",
            "test_bad_run_is_in_json_terminal_and_report[scale never stable]",
            "test_bad_run_is_in_json_terminal_and_report[swapped gauges]",
            "test_flagged_run_is_named_with_its_own_recording",
        ),
        "analyses/approach_angle/report/test_campaign_page.py": (
            "test_the_same_input_gives_the_same_page",
        ),
        "analyses/approach_angle/test_campaign.py": (
            "test_set_run_twice_leaves_no_repeat_missing_elsewhere",
            "test_trend_of_one_wheel_ignores_the_set_names",
        ),
        "analyses/approach_angle/test_conformance.py": (),
        "analyses/static/test_conformance.py": ("test_static_law_passes_check_analysis",),
        "analyses/approach_angle/test_paper_simulated.py": (),
        "analyses/lugre/lateral/test_carried.py": (
            "test_friction_of_another_floor_is_named",
            "test_known_friction_needs_one_current",
        ),
        "analyses/lugre/lateral/test_conformance.py": (),
        "analyses/lugre/lateral/test_identify.py": (
            "test_half_the_lever_is_named",
            "test_lever_on_the_other_side_is_named",
            "test_lifted_rows_that_do_not_rub_are_recognised",
            "test_one_speed_gives_friction_at_that_speed",
            "test_samples_that_are_nan_exclude_a_trial",
            "test_stated_friction_contradicts_a_wrong_lever",
            "test_turned_lateral_speed_is_named",
        ),
        "analyses/lugre/lateral/test_reduced.py": ("test_either_law_is_held_by_intervals",),
        "analyses/lugre/test_by_law.py": ("test_a_floor_of_the_paper_supports_4_parameters",),
        "analyses/lugre/test_checked.py": (
            "test_another_law_leaves_no_number_of_method_a",
            "test_named_misfit_stands_above_other_warnings",
        ),
        "analyses/lugre/test_conformance.py": (),
        "analyses/lugre/test_design.py": (
            "test_predicted_duration_is_that_of_dry_run",
            "test_what_cannot_be_designed_is_refused[change1-targets1-0.02-no test fits]",
        ),
        "analyses/lugre/test_diagnosis.py": (
            "test_a_constant_on_its_way_is_not_suspected",
            "test_a_measuring_wheel_out_of_centre_is_named",
            "test_constant_is_named_not_a_law_without_size",
            "test_rig_with_correct_constants_fits",
            "test_scale_of_an_encoder_is_named_beside_radius",
        ),
        "analyses/lugre/test_hidden_rigs.py": ("test_intervals_hold_truth_of_hidden_rig",),
        "analyses/lugre/test_identify.py": (
            "test_accuracy_on_the_papers_procedure[1-paperboard",
            "test_accuracy_on_the_papers_procedure[1-stone",
            "test_constants_unknown_to_the_paper_are_flagged[1-paperboard",
            "test_constants_unknown_to_the_paper_are_flagged[1-stone",
            "test_forgotten_rolling_resistance_moves_sigma_0_as_documented",
            "test_friction_is_unknown_if_V_s_is_open[1-paperboard",
            "test_friction_is_unknown_if_V_s_is_open[1-stone",
            "test_intervals_cover_the_truth[paperboard",
            "test_intervals_cover_the_truth[stone",
            "test_quoted_friction_interval_contains_the_truth[1-paperboard",
            "test_quoted_friction_interval_contains_the_truth[1-stone",
            "test_robust_loss_reduces_error_from_accelerometer_spikes",
            "test_sentences_keep_to_the_allowed_and_the_possible[paperboard",
            "test_sentences_keep_to_the_allowed_and_the_possible[stone",
            "test_sigma_1_never_reads_as_known[paperboard",
            "test_sigma_1_never_reads_as_known[stone",
            "test_the_curve_begins_where_the_slip_is_resolved[paperboard",
            "test_the_curve_begins_where_the_slip_is_resolved[stone",
            "test_the_curve_stays_on_the_visited_slip",
            "test_two_runs_agree_bit_for_bit",
        ),
        "analyses/lugre/test_misfit.py": (
            "test_a_spoilt_channel_gives_no_unknown_number[acceleration noisy]",
            "test_a_wrong_constant_gives_no_unknown_number[guide friction tenfold]",
            "test_a_wrong_constant_gives_no_unknown_number[no rolling resistance]",
            "test_a_wrong_constant_gives_no_unknown_number[radius 1 % large]",
        ),
        "analyses/lugre/test_output_error.py": (
            "test_creeping_carriage_is_left_out_and_named",
            "test_diameter_for_radius_gives_no_number",
            "test_paperboard_ends_at_its_optimum",
            "test_recordings_begin_at_angles_of_their_own",
            "test_recordings_that_agree_are_pooled",
            "test_recordings_that_disagree_are_not_pooled",
            "test_unknown_gravity_is_named_where_it_decides",
            "test_wear_over_the_trials_gives_no_number",
        ),
        "analyses/lugre/test_posterior.py": (
            "test_credible_intervals_are_those_of_profiles",
            "test_marginal_is_what_refits_give",
            "test_model_that_does_not_fit_has_no_posterior",
        ),
        "analyses/lugre/test_reading.py": (
            "test_guide_friction_follows_mass_it_was_measured_at",
            "test_guide_friction_without_mass_is_not_scaled",
            "test_light_carriage_intervals_contain_the_friction",
        ),
        "analyses/lugre/test_recursion.py": ("test_kernel_matches_ode_solver_with_second_order",),
        "analyses/lugre/test_together.py": (
            "test_floors_with_unlike_drives_stay_apart",
            "test_masses_on_one_floor_share_friction",
        ),
        "analyses/lugre/test_validation.py": (
            "test_gain_and_zero_together_are_both_named",
            "test_implausible_constant_is_a_suspect_only",
            "test_late_encoder_is_named[late_carriage-carriage_delay]",
            "test_torque_constant_that_is_off_is_named",
            "test_zero_of_a_current_may_be_a_resistance",
            "test_zero_of_the_current_is_named[pvc-0.005]",
            "test_zero_of_the_current_is_named[stone--0.01]",
        ),
        "analysis/test_selection.py": ("test_smoothed_samples_count_for_less",),
        "analysis/test_several_recordings.py": (
            "test_only_trials_that_entered_the_fit_count",
            "test_recordings_can_be_identified_each_by_itself",
            "test_repeats_of_one_rig_agree",
            "test_the_report_names_each_recording",
            "test_unlike_recordings_are_reported_and_disagree",
        ),
    },
    "made, installed and tried as its author or a user would": {
        "cli/test_new.py": (
            "test_a_friction_law_passes_and_is_found",
            "test_a_plant_installs_passes_its_tests_and_runs",
            "test_an_analysis_that_is_made_passes_its_tests",
            "test_new_package_installs_and_passes_its_own_tests[block]",
            "test_new_package_installs_and_passes_its_own_tests[scpi]",
            "test_new_package_installs_and_passes_its_own_tests[serial]",
            "test_new_package_installs_and_passes_its_own_tests[slow]",
            "test_new_package_is_typed_and_formatted_like_rigd",
        ),
        "packaging/test_arrays.py": ("test_dataclasses_with_arrays_are_compared_by_identity",),
        "packaging/test_dependencies.py": (),
        "packaging/test_extras.py": (
            "test_command_names_the_missing_extra[serve --rig",
            "test_command_names_the_missing_extra[sim angle-wire-1-ni]",
            "test_command_without_extras_succeeds[check",
            "test_command_without_extras_succeeds[doctor]",
            "test_command_without_extras_succeeds[run constant_current --rig",
            "test_daemon_without_extras_serves_without_a_panel",
            "test_recover_without_extras_repairs_the_file",
        ),
        "packaging/test_names.py": ("test_no_variable_has_the_name_one",),
        "packaging/test_wheel.py": ("test_the_installed_wheel_runs_from_any_folder",),
        "record/test_other_systems.py": (),
    },
    "the page in a browser, beyond stops, control and a run": {
        "panel/test_call.py": (),
        "panel/test_layout.py": (),
        "panel/test_page.py": (
            "test_a_maintainer_takes_over_and_tares",
            "test_an_interrupted_run_is_offered_and_can_wait",
            "test_choosing_the_open_procedure_keeps_typed_values",
            "test_control_changes_hands_between_two_browsers",
            "test_interlocks_are_called_clear_only_while_watched",
            "test_past_run_is_drawn_without_control",
            "test_report_is_made_and_read_without_its_scripts",
            "test_slow_computer_gets_fewer_frames_close_to_now",
            "test_text_of_rig_cannot_reverse_line",
            "test_traces_are_held_moved_zoomed_and_live_again",
        ),
        "panel/test_page_reach.py": (),
        "panel/test_page_stops.py": (
            "test_a_stop_replaces_no_waiting_abort",
            "test_an_undelivered_stop_can_be_withdrawn",
            "test_page_cut_off_shows_it_and_recovers",
        ),
        "panel/test_plane.py": (
            "test_bodies_shown_are_those_last_chosen",
            "test_held_plane_shows_that_time",
            "test_plane_has_room",
        ),
        "panel/test_presses.py": (
            "test_a_key_pressed_elsewhere_presses_no_button",
            "test_a_pointer_pressed_elsewhere_presses_no_button",
            "test_button_that_has_moved_takes_no_press_yet",
            "test_button_uncovered_by_dialog_takes_no_press_yet",
            "test_enter_held_on_start_only_opens_the_dialog",
            "test_enter_pressed_again_too_soon_answers_nothing",
            "test_resuming_is_confirmed_with_all_that_will_happen",
            "test_second_tap_does_not_answer_next_question",
        ),
    },
    "another fault, signal or kill of a rig in real time": {
        "drivers/lines/test_conformance.py": ("test_it_keeps_what_a_slow_driver_promises[False",),
        "drivers/lines/test_driver.py": (
            "test_damaged_line_never_becomes_a_number[garbage-False]",
            "test_damaged_line_never_becomes_a_number[merged",
            "test_damaged_line_never_becomes_a_number[nul",
            "test_lasting_fault_ends_with_its_cause[comma",
            "test_lasting_fault_ends_with_its_cause[unplug",
        ),
        "drivers/test_card_conformance.py": (
            "test_it_conforms[lateral_belt]",
            "test_it_conforms[wheel_encoder]",
            "test_it_conforms[wheel_servo]",
        ),
        "drivers/ni_io/test_conformance.py": (),
        "drivers/test_ni_daq.py": ("test_crystals_drift_is_seen_against_machines_clock",),
        "engine/recorder/test_recorder.py": ("test_repeatedly_killed_recorder_loses_nothing",),
        "engine/slow/test_latest.py": ("test_no_row_is_ever_torn",),
        "engine/slow/test_ni_in_helper.py": (
            "test_an_overrun_of_the_card_ends_the_run",
            "test_wrong_card_is_refused_before_anything_is_read",
        ),
        "engine/test_process_host.py": (
            "test_arming_waits_for_the_device_and_gives_up",
            "test_cycle_lost_in_preflight_blocks_by_its_reason",
            "test_cycle_slow_at_make_safe_is_not_killed",
            "test_next_program_is_skipped_after_early_end",
            "test_nothing_is_armed_after_the_cycle_has_acted",
            "test_setpoints_are_held_between_two_programs",
            "test_stop_after_a_rest_prevents_the_next_program",
            "test_stop_is_not_forgotten_for_trip_that_follows",
            "test_unsafe_devices_are_made_safe_over_second_link",
        ),
        "engine/test_windows_between_processes.py": ("test_without_windows_all_rows_are_recorded",),
        "sim/fmu/test_examples.py": ("test_robot_unit_of_fmi_3_is_the_plant",),
        "sim/fmu/test_plant.py": (
            "test_failing_unit_ends_the_run_with_its_name[discard",
            "test_failing_unit_ends_the_run_with_its_name[exit",
            "test_failing_unit_ends_the_run_with_its_name[nan",
            "test_failing_unit_ends_the_run_with_its_name[sleep",
            "test_plant_keeps_the_promises_that_apply",
        ),
        "sim/wire/test_bench.py": (
            "test_killed_simulation_does_not_block_the_next",
            "test_one_folder_serves_one_simulation",
        ),
        "system/test_actuators_wire.py": ("test_fault_of_an_actuator_is_named",),
        "system/test_angle_wire.py": (
            "test_dead_potentiometer_is_stopped_by_drive_time_limit",
            "test_killed_with_the_relay_closed_it_opens[all-SIGKILL]",
            "test_killed_with_the_relay_closed_it_opens[cycle-SIGSTOP]",
            "test_killed_with_the_relay_closed_it_opens[daemon-SIGKILL]",
            "test_watchdog_that_stays_up_prevents_arming",
        ),
        "system/test_articulated_wire.py": ("test_fault_ends_the_run_named_and_safe",),
        "system/test_daemon.py": (
            "test_a_signal_ends_the_run_then_the_daemon[2-aborted]",
            "test_all_processes_killed_at_once_lose_no_sample",
        ),
        "system/test_faults.py": (
            "test_a_fault_ends_the_run[traction exception]",
            "test_a_fault_ends_the_run[wheel_encoder tpdo_short]",
            "test_a_run_is_refused_before_anything_moves[servo_bus second_rigd before]",
        ),
        "system/test_in_loop_wire.py": (),
        "system/test_ni_card_wire.py": (
            "test_fault_of_card_ends_run_with_its_name",
            "test_kill_leaves_outputs_at_rest_and_every_sample[all",
            "test_kill_leaves_outputs_at_rest_and_every_sample[cycle-SIGSTOP",
            "test_kill_leaves_outputs_at_rest_and_every_sample[cycle-SIGTERM",
            "test_kill_leaves_outputs_at_rest_and_every_sample[daemon",
            "test_kill_leaves_outputs_at_rest_and_every_sample[recorder",
            "test_quick_procedure_completes_on_the_card",
        ),
        "system/test_kills.py": (
            "test_kill_while_controller_acts_leaves_safe_rig[all]",
            "test_kill_while_controller_acts_leaves_safe_rig[cycle]",
            "test_kill_while_controller_acts_leaves_safe_rig[cycle held]",
            "test_kill_while_controller_acts_leaves_safe_rig[daemon held]",
            "test_kill_leaves_safe_rig_and_every_sample[all-SIGHUP-None]",
            "test_kill_leaves_safe_rig_and_every_sample[all-SIGSTOP-None]",
            "test_kill_leaves_safe_rig_and_every_sample[cycle-SIGSTOP-None]",
            "test_kill_leaves_safe_rig_and_every_sample[cycle-SIGTERM-SIGTERM]",
            "test_kill_leaves_safe_rig_and_every_sample[daemon-SIGSTOP-None]",
            "test_kill_leaves_safe_rig_and_every_sample[daemon-SIGTERM-SIGSTOP]",
        ),
        "system/test_lines_wire.py": ("test_doctor_shows_what_came_instead",),
        "system/test_manual.py": (
            "test_doctor_names_every_fault_beside_sound_devices",
            "test_doctor_without_simulation_suggests_rigd_sim",
            "test_read_for_duration_prints_lines_of_chosen_channels",
            "test_read_shows_active_interlock_and_continues",
            "test_rig_in_use_is_refused_until_ctrl_c",
            "test_tare_reports_refused_and_unknown_actions",
        ),
        "system/test_prompts.py": (
            "test_lines_typed_before_question_do_not_answer_it",
            "test_person_is_asked_until_rig_agrees",
            "test_real_rig_takes_file_answers_only_by_choice",
        ),
        "system/test_real_rig.py": ("test_rig_without_devices_is_blocked_with_the_reason",),
        "system/test_run_signals.py": (
            "test_signal_stops_run_safe_with_its_file_finished[SIGHUP-SIGHUP]",
            "test_signal_stops_run_safe_with_its_file_finished[SIGTERM-SIGTERM]",
        ),
        "system/test_slow_setpoints.py": (
            "test_oven_that_stays_on_is_named",
            "test_stop_by_a_person_switches_it_off",
        ),
        "system/test_unauthenticated.py": (),
    },
    "another case of what `make test` shows with one": {
        "drivers/canopen/test_conformance.py": (
            "test_can_drivers_work_as_drivers_do[RotaryServo",
            "test_can_drivers_work_as_drivers_do[SpeedServo",
        ),
        "analyses/lugre/test_coverage_study.py": (),
        "analyses/lugre/test_wrong_worlds.py": (),
        "analyses/test_spoilt.py": (),
        "analysis/check/test_check_analysis.py": (
            "test_each_broken_promise_is_found[Boastful-recovers the truth (case 1)-which the",
            "test_each_broken_promise_is_found[Crashing-refuses what it cannot read (case 1)-",
            "test_each_broken_promise_is_found[Curt-refuses what it cannot read (case 1)-refu",
            "test_each_broken_promise_is_found[Missing-recovers the truth (case 1)-mean is no",
            "test_each_broken_promise_is_found[Trusting-refuses what it cannot read (case 1)-",
            "test_each_broken_promise_is_found[Vague-recovers the truth (case 1)-only]",
        ),
        "analysis/report/test_models.py": (
            "test_page_reports_what_the_data_support",
            "test_page_without_comparison_has_no_such_part",
        ),
        "analysis/report/test_opening.py": ("test_page_and_terminal_begin_with_both_sentences",),
        "analysis/report/test_quoted.py": ("test_trials_with_equal_names_are_distinguished",),
        "analysis/report/test_render.py": (
            "test_biased_without_interval_is_not_called_unidentifiable",
            "test_bytes_do_not_depend_on_settings_of_matplotlib",
            "test_hostile_text_is_shown_as_it_is",
            "test_unidentifiable_value_appears_only_in_the_starts",
        ),
        "cli/remote/test_commands.py": ("test_holder_of_the_lease_is_named",),
        "cli/remote/test_watch.py": (
            "test_a_prompt_that_another_answers_leaves_the_terminal",
            "test_ctrl_c_asks_and_may_end_only_watching",
            "test_ctrl_c_question_can_be_left_unanswered",
            "test_observer_ctrl_c_without_terminal_ends_only_watching",
            "test_request_for_control_is_shown",
            "test_run_begun_by_another_is_watched_to_end",
        ),
        "cli/test_asking.py": ("test_only_this_module_reads_what_a_person_types",),
        "cli/test_screen.py": (
            "test_no_word_is_cut_in_a_narrow_terminal[driver]",
            "test_no_word_is_cut_in_a_narrow_terminal[drivers]",
        ),
        "daemon/live/test_monitor.py": ("test_failure_to_show_is_reported_once_and_retried",),
        "daemon/serve/test_client_loss.py": (
            "test_client_that_releases_lease_is_not_lost",
            "test_ending_trial_gets_no_answer_to_its_prompt",
            "test_resumed_run_can_continue_without_client",
            "test_run_may_continue_when_its_client_vanishes",
            "test_run_may_end_trial_if_its_client_vanishes",
        ),
        "daemon/serve/test_service.py": (
            "test_answers_of_procedure_are_used_on_request",
            "test_blocked_run_reports_the_reason",
            "test_folder_removed_during_run_spoils_no_later_run",
            "test_only_lease_holder_answers_prompts",
            "test_person_behind_a_shared_client_is_recorded",
            "test_second_start_is_refused_during_a_run",
            "test_stop_ends_a_waiting_prompt",
        ),
        "daemon/test_forms.py": ("test_time_stamps_are_wall_time_despite_long_preparation[0]",),
        "drivers/ni_relay/test_ni_relay.py": (
            "test_next_client_clears_what_killed_one_left",
            "test_relay_of_running_client_is_refused",
        ),
        "engine/test_controllers.py": ("test_end_at_friction_acts_in_cycle_seeing_it[100]",),
        "panel/test_fuzz.py": (),
        "procedure/test_editor.py": ("test_no_quantity_that_check_accepts_is_refused",),
        "procedure/test_fuzz.py": ("test_no_misspelt_key_goes_unnoticed",),
        "record/test_damage.py": (
            "test_damage_in_every_part_of_a_file[none]",
            "test_random_damage_costs_only_the_chunks_it_touches",
        ),
        "record/test_foreign.py": ("test_no_flipped_byte_goes_unnoticed",),
        "record/test_recover.py": ("test_interrupted_flush_loses_no_earlier_row[1050]",),
        "record/test_strict.py": ("test_recovered_and_continued_recordings",),
        "remote/test_spoofing.py": ("test_client_cannot_publish_a_status[over_tls]",),
        "sdk/test_check_plant.py": (
            "test_angle_plant_keeps_every_rule",
            "test_articulated_plant_keeps_every_rule[linear]",
            "test_articulated_plant_keeps_every_rule[smooth]",
        ),
        "sim/angle/test_devices.py": ("test_compilation_is_done_at_opening",),
        "system/test_replay.py": (
            "test_replaying_the_setpoints_gives_the_readings[lz4]",
            "test_replaying_the_setpoints_gives_the_readings[none]",
        ),
        "system/test_seeds.py": (),
    },
}

#: Files with a long test.
FILES: Final = frozenset(file for files in LONG.values() for file in files)
#: Files of which every test is long.
WHOLE: Final = frozenset(file for files in LONG.values() for file, ids in files.items() if not ids)


def reason(file: str, test: str) -> str | None:
    """Return why a test is long; None if it is not."""
    for why, files in LONG.items():
        if file in files and test.startswith(files[file] or ("",)):
            return why
    return None


def unknown(tests: Iterable[tuple[str, str]]) -> list[str]:
    """Return what is listed of the files of these tests and is the beginning of none of them."""
    known: dict[str, list[str]] = {}
    for file, test in tests:
        known.setdefault(file, []).append(test)
    return [
        f"{file}::{begins}"
        for files in LONG.values()
        for file in files.keys() & known.keys()
        for begins in files[file]
        if not any(test.startswith(begins) for test in known[file])
    ]
