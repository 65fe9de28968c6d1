"""The checks are registered explicitly: a module's checks are those that it lists."""

from pathlib import Path

from page_tables import with_tables

from mission.autopilots import ARDUPILOT, PX4
from wbf_mission.addons.check.registry import CheckResult, Checks, Verdict
from wbf_mission.addons.check.runner import _MODULES, all_checks


def test_the_catalog_has_each_modules_checks_once_and_in_groups():
    ids = [one.id for one in all_checks()]
    assert sorted(ids) == sorted(one.id for module in _MODULES for one in module.check)
    assert len(set(ids)) == len(ids)
    groups = list(dict.fromkeys(one.group for one in all_checks()))
    assert groups == ["identity", "command", "telemetry", "param", "mission", "transfer", "fly"]
    assert [one.group for one in all_checks()] == sorted(
        (one.group for one in all_checks()), key=groups.index
    ), "a group's checks run one after the other"


def test_a_requirement_may_hold_for_some_autopilots_only():
    checks = Checks()

    @checks("mission.kept", "it is kept", required=lambda profile: profile.atomic, suffers="who flies it")
    def kept(peer):
        raise AssertionError(peer)

    (one,) = checks
    assert (one.requirement(PX4), one.requirement(ARDUPILOT), one.required_of) == (True, False, "PX4")
    assert CheckResult(one, False, Verdict.FAILED, "lost", 0.0).told == "lost (trouble for who flies it)"
    assert CheckResult(one, True, Verdict.FAILED, "lost", 0.0).told == "lost"
    assert CheckResult(one, False, Verdict.PASSED, "", 0.0).told == ""


def test_the_page_prints_the_checks():
    page = (Path(__file__).parents[4] / "docs" / "check.md").read_text(encoding="utf-8")
    printed = [line for line in with_tables(page).splitlines() if line.startswith("| `")]
    assert printed == [
        f"| `{one.id}` | {one.text} | {one.required_of} | {one.suffers} |" for one in all_checks()
    ]
