"""The command line as it is made from the options of the parts."""

import re
from typing import Any

import pytest
from advice import commands

from wbf_mission.cli.app import main
from wbf_mission.cli.help import HELP_ALL
from wbf_mission.cli.options import Given, scenario_options
from wbf_mission.scenario import Scenario, ScenarioError, WeatherOptions
from wbf_mission.scenario.option import Part
from wbf_mission.scenario.parts import CAMERA_OF_PLANS
from wbf_mission.scenario.scenario import PARTS, all_options

COMMANDS = ("plan", "fly", "sim")


def flags_of(part: type[Part]) -> set[str]:
    own = {one.flag for kind, _, one in all_options().values() if kind is part and one.flag}
    return own | {flag.flag for flag in part.COMPOUND}


def helped(capsys: pytest.CaptureFixture[str], command: str) -> str:
    assert main([command, HELP_ALL]) == 0
    return " ".join(capsys.readouterr().out.split())


def test_fly_has_every_option_of_every_part_but_those_of_plans(capsys: pytest.CaptureFixture[str]) -> None:
    text, known = helped(capsys, "fly"), all_options()
    of_plans = {known[key][2].flag for key in CAMERA_OF_PLANS}
    for part in PARTS.values():
        assert flags_of(part)
        for flag in flags_of(part):
            assert (f"{flag} " in text) == (flag not in of_plans)
    for _, _, one in known.values():
        assert one.flag is None or one.flag in of_plans or one.help.split()[0] in text


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_defaults_and_dependence(capsys: pytest.CaptureFixture[str], command: str) -> None:
    text = helped(capsys, command)
    assert "(only with --wind)" in text
    assert "[default: miniberry-30]" in text
    assert "[default: quad]" in text
    assert "0.05 to 1000 m" in text or command == "sim"
    assert ("(not with --mission)" in text) == (command in ("fly", "plan"))


def listed(text: str) -> list[str]:
    """The options that begin a line of a help, without its examples."""
    return re.findall(r"^  (?:-\w, )?(--[a-z-]+)", text, re.MULTILINE)


def own_flags(command: Any) -> list[str]:
    return [
        next(flag for flag in parameter.opts if flag.startswith("--"))
        for parameter in command.params
        if parameter.param_type_name == "option" and HELP_ALL not in parameter.opts
    ]


@pytest.mark.parametrize("name", commands())
def test_help_of_many_options_shows_those_for_beginners(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = commands()[name]
    flags = own_flags(command)
    assert main([*name.split(), "--help"]) == 0
    text = capsys.readouterr().out
    if len(flags) <= 20:
        assert (command.beginners, sorted(listed(text))) == ((), sorted(["--help", *flags]))
        assert main([*name.split(), HELP_ALL]) == 2
        return
    assert 8 <= len(command.beginners) <= 12
    assert listed(text) == [*command.beginners, "--help", HELP_ALL]
    assert f"{HELP_ALL}  Show all {len(flags)} options and exit." in text
    arguments = [parameter.name for parameter in command.params if parameter.param_type_name == "argument"]
    assert all(f"\n  {argument} <" in text for argument in arguments)
    assert main([*name.split(), HELP_ALL]) == 0
    whole = capsys.readouterr().out
    assert sorted(listed(whole)) == sorted(["--help", HELP_ALL, *flags])
    panels = {getattr(parameter, "rich_help_panel", None) for parameter in command.params} - {None}
    assert all(f"\n{panel}:\n" in whole for panel in panels)
    assert text.split("Examples:")[1] == whole.split("Examples:")[1]


def test_a_beginner_sees_these_options_of_fly(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly", "-h"]) == 0
    needed = {"farm", "planner", "policy", "budget", "vehicle", "autopilot", "connect", "live", "estimator"}
    needed |= {"seed", "out", "mission"}
    assert set(listed(capsys.readouterr().out)) == {f"--{name}" for name in needed} | {"--help", HELP_ALL}


def test_the_help_of_all_options_is_no_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly", "--farm", "nowhere", HELP_ALL]) == 0
    assert main(["fly", "--seed", "x", HELP_ALL]) == 0
    assert main(["upload", HELP_ALL]) == 0
    assert "Arguments:\n  file" in capsys.readouterr().out
    assert main(["fly", "--no-files", "--farm", "nowhere"]) == 2


@pytest.mark.parametrize("command", COMMANDS)
def test_help_names_no_types_of_python(capsys: pytest.CaptureFixture[str], command: str) -> None:
    text = helped(capsys, command)
    assert ("--fault TEXT" in text) == (command != "plan")
    assert ("[default: camera; with ArduPilot, no-camera" in text) == (command == "sim")
    assert "True" not in text.replace("True development", "") and "list[" not in text


@pytest.mark.parametrize("command", ["plan", "fly", "sim"])
def test_shared_options_read_the_same(capsys: pytest.CaptureFixture[str], command: str) -> None:
    text, fly = helped(capsys, command), helped(capsys, "fly")
    for flag in sorted(flags_of(WeatherOptions) - {"--turbulence"}):
        (told,) = re.findall(rf"{flag} [A-Z]{{3}}.*?\[default: [^\]]*\]", text)
        assert told in fly


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--wind-shear", "log"], "--wind-shear has an effect only with --wind"),
        (["--mission", "x.plan", "--budget", "5min"], "--budget has no effect with --mission x.plan"),
        (["--mission", "x.plan", "--camera-spacing", "2"], "--camera-spacing has no effect"),
        (["--param", "MPC_ACC_HOR"], "NAME=VALUE"),
        (["--day", "127"], "0 to 126"),
    ],
)
def test_options_without_effect_are_refused(
    capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    assert main(["fly", "--no-files", *arguments]) == 2
    assert says in capsys.readouterr().err


def test_given_options_change_the_file(tmp_path: pytest.TempPathFactory) -> None:
    path = tmp_path / "run.toml"  # type: ignore[operator]
    path.write_text('farm = "miniberry-10"\nday = 3\nwind_speed_m_s = 2.0\n[parameters]\nA = 1.0\n')
    given = Given(path, {"day": 4, "wind_shear": "log", "parameters": {"B": 2.0}}, {}, {})
    scenario = given.scenario()
    assert (scenario.farm.name, scenario.farm.day, scenario.weather.wind_shear) == ("miniberry-10", 4, "log")
    assert scenario.vehicle.parameters == {"A": 1.0, "B": 2.0}
    assert Given(None, {}, {}, {"vehicle": "ideal"}).scenario() == Scenario(vehicle="ideal")
    with pytest.raises(ScenarioError, match="only with --wind"):
        Given(None, {"wind_shear": "log"}, {}, {}).scenario()


def test_a_command_must_not_have_an_option_twice() -> None:
    def command(given: Given, turbulence: str = "") -> None: ...

    with pytest.raises(TypeError, match="turbulence"):
        scenario_options("weather")(command)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fly", "--seed", "1_0"], "'--seed': '1_0' is not a whole number"),
        (["fly", "--speed", "1_0"], "'--speed': '1_0' is not a number"),
        (["fly", "--altitude", "1_0"], "'--altitude': '1_0' is not a number"),
        (["plan", "--wind", "1_0,270"], "--wind '1_0,270' is not SPEED,FROM"),
        (["plan", "--wind", "5,270", "--wind-shear", "log,0_1"], "--wind-shear 'log,0_1'"),
        (["plan", "--param", "NAV_ACC_RAD=1_0"], "--param 'NAV_ACC_RAD=1_0'"),
        (["bench", "run", "--out", "x", "--seeds", "1_0"], "seeds '1_0': '1_0' is neither a seed"),
        (["bench", "run", "--out", "x", "--seeds", "0"], "seeds 0 are neither a number of seeds"),
        (["bench", "run", "--out", "x", "--jobs", "-2"], "-2 is out of range: give -1 to 1024"),
        (["farm", "generate", "miniberry-10", "--count", "1_0"], "'--count': '1_0' is not a whole number"),
        (["farm", "generate", "miniberry-10", "--days", "127"], "127 is out of range: give 0 to 126"),
    ],
)
def test_numbers_are_digits(capsys: pytest.CaptureFixture[str], arguments: list[str], says: str) -> None:
    assert main(arguments) == 2
    assert says in capsys.readouterr().err


def test_help_says_the_range_beside_what_it_is_of(capsys: pytest.CaptureFixture[str]) -> None:
    text = helped(capsys, "fly")
    fence = "Geofence METRES outside the farm's border, 1 to 1000 m; exclusion zones round obstacles"
    assert f"--fence METRES {fence} (not with --mission). [default: none]" in text
    assert "Autopilot to simulate: px4 or ardupilot. [default: px4]" in text
