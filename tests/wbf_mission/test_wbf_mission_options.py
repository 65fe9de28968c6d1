"""The command line as it is made from the options of the parts."""

import re

import pytest
from advice import commands

from wbf_mission.cli.app import main
from wbf_mission.cli.help import HELP_ALL
from wbf_mission.cli.options import Given, scenario_options
from wbf_mission.scenario import Scenario, ScenarioError
from wbf_mission.scenario.parts import CAMERA_OF_PLANS
from wbf_mission.scenario.scenario import PARTS, all_options


def flags_of(part):
    own = {one.flag for kind, _, one in all_options().values() if kind is part and one.flag}
    return own | {flag.flag for flag in part.COMPOUND}


def helped(capsys, command):
    assert main([command, HELP_ALL]) == 0
    return " ".join(capsys.readouterr().out.split())


def test_fly_has_every_option_of_every_part_but_those_of_plans(capsys):
    text, known = helped(capsys, "fly"), all_options()
    of_plans = {known[key][2].flag for key in CAMERA_OF_PLANS}
    for part in PARTS.values():
        assert flags_of(part)
        for flag in flags_of(part):
            assert (f"{flag} " in text) == (flag not in of_plans)
    for _, _, one in known.values():
        assert one.flag is None or one.flag in of_plans or one.help.split()[0] in text


def listed(text):
    """The options that begin a line of a help, without its examples."""
    return re.findall(r"^  (?:-\w, )?(--[a-z-]+)", text, re.MULTILINE)


def own_flags(command):
    return [
        next(flag for flag in parameter.opts if flag.startswith("--"))
        for parameter in command.params
        if parameter.param_type_name == "option" and HELP_ALL not in parameter.opts
    ]


@pytest.mark.parametrize("name", commands())
def test_help_of_many_options_shows_those_for_beginners(name, capsys):
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


def test_the_help_of_all_options_is_no_run(capsys):
    assert main(["fly", "--farm", "nowhere", HELP_ALL]) == 0
    assert main(["fly", "--seed", "x", HELP_ALL]) == 0
    assert main(["upload", HELP_ALL]) == 0
    assert "Arguments:\n  file" in capsys.readouterr().out
    assert main(["fly", "--no-files", "--farm", "nowhere"]) == 2


def test_given_options_change_the_file(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text('farm = "miniberry-10"\nday = 3\nwind_speed_m_s = 2.0\n[parameters]\nA = 1.0\n')
    given = Given(path, {"day": 4, "wind_shear": "log", "parameters": {"B": 2.0}}, {}, {})
    scenario = given.scenario()
    assert (scenario.farm.name, scenario.farm.day, scenario.weather.wind_shear) == ("miniberry-10", 4, "log")
    assert scenario.vehicle.parameters == {"A": 1.0, "B": 2.0}
    assert Given(None, {}, {}, {"vehicle": "ideal"}).scenario() == Scenario(vehicle="ideal")
    with pytest.raises(ScenarioError, match="only with --wind"):
        Given(None, {"wind_shear": "log"}, {}, {}).scenario()


def test_a_command_must_not_have_an_option_twice():
    def command(given, turbulence=""): ...

    with pytest.raises(TypeError, match="turbulence"):
        scenario_options("weather")(command)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("fly --wind-shear log", "--wind-shear has an effect only with --wind"),
        ("fly --mission x.plan --budget 5min", "--budget has no effect with --mission x.plan"),
        ("fly --mission x.plan --camera-spacing 2", "--camera-spacing has no effect"),
        ("fly --param MPC_ACC_HOR", "NAME=VALUE"),
        ("fly --day 127", "0 to 126"),
        ("fly --seed 1_0", "'--seed': '1_0' is not a whole number"),
        ("fly --speed 1_0", "'--speed': '1_0' is not a number"),
        ("plan --wind 1_0,270", "--wind '1_0,270' is not SPEED,FROM"),
        ("plan --wind 5,270 --wind-shear log,0_1", "--wind-shear 'log,0_1'"),
        ("plan --param NAV_ACC_RAD=1_0", "--param 'NAV_ACC_RAD=1_0'"),
        ("bench run --out x --seeds 1_0", "seeds '1_0': '1_0' is neither a seed"),
        ("bench run --out x --jobs -2", "-2 is out of range: give -1 to 1024"),
    ],
)
def test_options_without_effect_and_odd_numbers_are_refused(capsys, words, says):
    assert main(words.split()) == 2
    assert says in capsys.readouterr().err
