"""Which worker runs which tests of the slow part: half of them wait, mostly, and the others compute."""

SHARING = (
    "docs/test_docs_field_to_map.py",
    "wbf_mission/test_wbf_mission_processors.py",
)
"""Files whose tests share something costly: one worker runs them."""

WAITING = (
    "tests/clients/",
    "addons/cluster/",
    "addons/mavsdk/",
    "addons/operate/test_operate_live.py",
    "addons/operate/test_operate_live_fleet.py",
    "addons/operate/test_operate_live_sorties.py",
    "addons/operate/test_operate_resume_link.py",
    "test_mavsdks_server_plugins",
    "test_wbf_mission_bad_links.py",
    "test_wbf_mission_live_control.py",
    "test_wbf_mission_live_page.py",
    "test_wbf_mission_studio_page.py",
    "test_wbf_mission_systems.py::test_a_client",
)
"""Tests that wait in real time more than they compute."""

LONGEST = (
    "test_nothing_is_left_to_compile",
    "test_the_types_hold_on_windows",
    "test_the_site_is_whole",
    "test_outputs_are_those_that_were_kept",
    "test_results_change_only_with_a_number",
    "test_wbf_mission_processors.py",
    "test_a_first_run_finds_the_estimator_compiled",
    "test_the_whole_paper",
    "test_the_report_of_waterberry",
    "test_docs_field_to_map.py",
    "test_an_included_network_is_the_one",
    "test_memory_is_flat",
    "test_at_any_moment_over_any_link",
    "test_a_link_that_breaks_after_any_message",
    "test_ours_conform[rolling-horizon]",
    "test_the_commands_of_a_page_run[days]",
    "test_everything_over_a_serial_line",
    "test_dronekit[guided_set_speed_yaw]",
    "test_a_pilot_takes_one_and_the_other_flies_on",
    "test_a_vehicle_that_is_killed",
)
"""Tests that are begun first; of the others none takes more than half a minute."""


def scheduling():
    """Return the class that divides the slow part among the workers of pytest-xdist.

    While processes and clients wait, two cores have something to compute; and few tests that wait run at once
    with many that compute, so that no client runs out of its time.
    """
    from xdist.scheduler import LoadFileScheduling

    class SlowPart(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = nodeid.split("::")[0]
            return file if file.endswith(SHARING) else nodeid

        def _assign_work_unit(self, node):
            waits = self.nodes.index(node) % 2 == 0
            # The best is of the kind that this worker prefers, then one of the longest.
            best = min(self.workqueue, key=lambda scope: (_has(scope, WAITING) != waits, _rank(scope)))
            self.workqueue.move_to_end(best, last=False)
            super()._assign_work_unit(node)

    return SlowPart


def _has(scope, names):
    return any(name in scope for name in names)


def _rank(scope):
    return next((number for number, name in enumerate(LONGEST) if name in scope), len(LONGEST))
