"""The checks are registered explicitly: a module's checks are those that it lists."""

from pathlib import Path

import pytest
from page_tables import with_tables

from mission.autopilots import ARDUPILOT, PX4
from wbf_mission.addons.check.peer import CheckError
from wbf_mission.addons.check.registry import CheckResult, Checks, Verdict
from wbf_mission.addons.check.runner import _MODULES, all_checks, chosen_checks


def test_the_catalog_has_each_modules_checks_once_and_in_groups():
    ids = [one.id for one in all_checks()]
    assert sorted(ids) == sorted(one.id for module in _MODULES for one in module.check)
    assert len(set(ids)) == len(ids)
    groups = list(dict.fromkeys(one.group for one in all_checks()))
    assert groups == ["identity", "command", "telemetry", "param", "mission", "transfer", "fly"]
    assert [one.group for one in all_checks()] == sorted(
        (one.group for one in all_checks()), key=groups.index
    ), "a group's checks run one after the other"


def test_choosing_by_id_and_by_group():
    (one,) = chosen_checks(("command.broadcast",), fly=False)
    assert one.id == "command.broadcast"
    assert {check.group for check in chosen_checks(("param", "identity"), fly=False)} == {"param", "identity"}
    assert not any(check.flies for check in chosen_checks((), fly=False))
    assert chosen_checks((), fly=True) == all_checks()
    with pytest.raises(CheckError, match=r"unknown check 'comand'.*identity, command"):
        chosen_checks(("comand",), fly=False)


def test_only_what_is_required_makes_a_result_bad():
    one = all_checks()[0]
    assert CheckResult(one, True, Verdict.FAILED, "", 0.1).bad
    assert not CheckResult(one, True, Verdict.SKIPPED, "", 0.1).bad
    assert not CheckResult(one, False, Verdict.FAILED, "", 0.1).bad
    summary = CheckResult(one, False, Verdict.FAILED, "why", 0.12345).summary()
    assert (summary["required"], summary["result"], summary["detail"]) == (False, "failed", "why")
    assert summary["seconds"] == 0.123


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


def test_advice_says_who_has_trouble_without_it():
    for one in all_checks():
        assert bool(one.suffers) == (one.required_of != "all"), one.id


def test_the_page_prints_the_checks():
    page = (Path(__file__).parents[4] / "docs" / "check.md").read_text(encoding="utf-8")
    printed = [line for line in with_tables(page).splitlines() if line.startswith("| `")]
    assert printed == [
        f"| `{one.id}` | {one.text} | {one.required_of} | {one.suffers} |" for one in all_checks()
    ]
