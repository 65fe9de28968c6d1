"""The checks are registered explicitly: a module's checks are those that it lists."""

import pytest

from wbf_mission.check.catalog import _MODULES, all_checks, chosen_checks
from wbf_mission.check.errors import CheckError
from wbf_mission.check.registry import CheckResult, Checks, Verdict


def test_the_catalog_has_each_modules_checks_once_and_in_groups():
    ids = [one.id for one in all_checks()]
    assert sorted(ids) == sorted(one.id for module in _MODULES for one in module.check)
    assert len(set(ids)) == len(ids)
    groups = list(dict.fromkeys(one.group for one in all_checks()))
    assert groups == ["identity", "command", "telemetry", "param", "mission", "transfer", "fly"]
    assert [one.group for one in all_checks()] == sorted(
        (one.group for one in all_checks()), key=groups.index
    ), "a group's checks run one after the other"


def test_another_list_does_not_change_the_catalog():
    before = all_checks()
    checks = Checks()

    @checks("identity.mine", "something of mine", required=False, flies=True)
    def mine(peer):
        raise AssertionError(peer)

    (one,) = checks
    assert (one.group, one.required, one.flies, one.function) == ("identity", False, True, mine)
    assert all_checks() == before


def test_choosing_by_id_and_by_group():
    (one,) = chosen_checks(("command.broadcast",), fly=False)
    assert one.id == "command.broadcast"
    assert {check.group for check in chosen_checks(("param", "identity"), fly=False)} == {"param", "identity"}
    assert not any(check.flies for check in chosen_checks((), fly=False))
    assert chosen_checks((), fly=True) == all_checks()
    with pytest.raises(CheckError, match=r"unknown check 'comand'.*identity, command"):
        chosen_checks(("comand",), fly=False)


def test_only_what_is_required_makes_a_result_bad():
    checks = {check.required: check for check in all_checks()}
    assert CheckResult(checks[True], Verdict.FAILED, "", 0.1).bad
    assert not CheckResult(checks[True], Verdict.SKIPPED, "", 0.1).bad
    assert not CheckResult(checks[False], Verdict.FAILED, "", 0.1).bad
    summary = CheckResult(checks[False], Verdict.FAILED, "why", 0.12345).summary()
    assert (summary["result"], summary["detail"], summary["seconds"]) == ("failed", "why", 0.123)
