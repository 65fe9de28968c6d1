"""Options of the command line, which are generated from the options of a scenario.

A command names parts of a scenario, and `scenario_options` adds the options of these parts to the command.
Names, help, ranges and defaults are defined only in the parts (`wbf_mission.scenario.parts`). This module
also defines options that are not part of a scenario, such as ``--json`` and ``--overwrite``.
"""

from __future__ import annotations

import functools
import inspect
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import typer

from geo.errors import WbfMissionError
from geo.texts import parse_number, parse_whole
from wbf_mission.cli.output import Output
from wbf_mission.scenario import FarmOptions, Scenario, ScenarioError, load_scenario, scenario_with
from wbf_mission.scenario.option import Option, Part, options_of
from wbf_mission.scenario.parts import RUN
from wbf_mission.scenario.scenario import PARTS, all_options

OUTPUT_PANEL = "Output"
CHECK_PANEL = "What is checked"


Number = TypeVar("Number", int, float)
Reader: TypeAlias = Callable[[str], Number]


def option(text: str, *names: str, panel: str | None = None, **more: Any) -> Any:
    """Return an option with the help `text` and the flags `names`, below the heading `panel`."""
    return typer.Option(*names, help=text, rich_help_panel=panel, **more)


def complete(kind: str) -> Callable[[str], list[str]]:
    """Return a function that completes names of a `kind`, such as farm, planner or vehicle."""

    def names(incomplete: str) -> list[str]:
        from wbf_mission.scenario.choice import names_of

        return [name for name in names_of(kind) if name.startswith(incomplete)]

    return names


def _reader(parse: Callable[[str], Number], low: float | None = None, high: float = 0.0) -> Reader[Number]:
    """Return a parser of numbers, in a range if given; the parser of typer would read ``1_0`` as 10."""

    def read(text: str) -> Number:
        try:
            value = parse(str(text))
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
        if low is not None and not low <= value <= high:
            raise typer.BadParameter(f"{value} is out of range: give {low} to {high}")
        return value

    return read


number = _reader(parse_number)


def whole_number_in(low: int, high: int) -> Reader[int]:
    """Return a parser of whole numbers from `low` to `high`."""
    return _reader(parse_whole, low, high)


_READERS: Mapping[Any, Reader[Any]] = {int: _reader(parse_whole), float: number}

Jobs = Annotated[
    int,
    option(
        "Number of processes; -1 uses one for each core.", parser=whole_number_in(-1, 1024), min=-1, max=1024
    ),
]


def require_processes(jobs: int) -> None:
    """Raise ScenarioError if the number of jobs is zero."""
    if jobs == 0:
        msg = "--jobs 0 runs nothing: give a number of processes, or -1 for one process per core"
        raise ScenarioError(msg)


ScenarioFile = Annotated[
    Path | None,
    option("Scenario file (TOML); other options change it.", "--scenario", panel=RUN),
]
LINK_PANEL = "The vehicle's link"
LINKS = "udpin:, udpout:, tcp: or tcpin:HOST:PORT, or serial:DEVICE:BAUD."
"""Forms that the address of a link may have, for the help."""
Way = Literal["own", "mavsdk"]
"""MAVLink client that talks to a real vehicle."""
Via = Annotated[
    Way,
    option("MAVLink client, part of wbf-mission (own) or independent (mavsdk).", panel=LINK_PANEL),
]
Wait = Annotated[
    float, option("Time to wait for the vehicle's heartbeat, s.", panel=LINK_PANEL, min=0.1, max=3600.0)
]
SystemId = Annotated[
    int | None,
    option(
        "System id of the vehicle, 1 to 255.  [default: the first vehicle heard]",
        panel=LINK_PANEL,
        parser=whole_number_in(1, 255),
    ),
]


def link(what: str) -> Any:
    """Return the option ``--connect``; its help begins with `what`."""
    return option(f"{what}: {LINKS}", panel=LINK_PANEL, metavar="LINK")


Connect = Annotated[str, link("Link to the vehicle")]


MISSION_SUFFIXES = (".plan", ".waypoints", ".wpl")
"""Suffixes of files that hold missions only; a .json, .txt, .kml or .gpx file may hold other data."""

Overwrite = Annotated[
    bool, option("Replace an existing output file, whatever its kind.", "--overwrite", panel=OUTPUT_PANEL)
]
"""Option to replace existing files, which `Force` does not do."""
Force = Annotated[
    bool, option("Continue despite errors of the preflight check.", "--force", panel=CHECK_PANEL)
]
"""Option to continue despite errors, which `Overwrite` does not do."""


class TargetError(WbfMissionError, ValueError):
    """Error of an output that would destroy a file or cannot be written."""


def refuse_overwrite(
    out: Path | None,
    inputs: Iterable[str | Path | None] = (),
    *,
    suffixes: tuple[str, ...] = (),
    overwrite: bool = False,
) -> None:
    """Raise TargetError if `out` is an input, a folder, a file of another kind, or in a missing folder.

    Inputs that are not files are ignored, and an input file is never replaced. `suffixes` are the suffixes
    that the command writes, in lower case. A file with another suffix is replaced only with `overwrite`.

    >>> refuse_overwrite(Path("/dev/null"), ["miniberry-30", None])
    """
    if out is None:
        return
    if out.is_dir():
        raise TargetError(f"{out}: is a folder; give the name of a file")
    if not out.parent.is_dir():
        raise TargetError(f"{out}: there is no folder {out.parent}; make the folder, or give another name")
    if not out.exists():
        return
    # A farm file's name may be followed by ``|`` and a layer.
    parts = (part for name in inputs if name is not None for part in (name, str(name).partition("|")[0]))
    named = map(Path, parts)
    for given in named:
        if given.exists() and out.samefile(given):
            raise TargetError(f"{out}: this is an input file; give another name for the output")
    if not overwrite and suffixes and out.is_file() and out.suffix.lower() not in suffixes:
        kinds = " or ".join(filter(None, suffixes))
        raise TargetError(f"{out}: this existing file is no {kinds} file; give another name, or --overwrite")


def _own(key: str, given: Any) -> Any:
    """Load a planner, policy or estimator given as FILE.py:NAME; return any other value unchanged."""
    if key not in ("planner", "policy", "estimator") or not isinstance(given, str) or ".py" not in given:
        return given
    from wbf_mission.own_code import own_choice

    return own_choice(given, key) or given


@dataclass(frozen=True, slots=True)
class Given:
    """The options of a run that were given on the command line."""

    file: Path | None
    """The scenario file, if given."""
    changes: dict[str, Any]
    """The given options of the scenario, by key."""
    others: dict[str, Any]
    """The given options that no scenario has, such as the simulator's, by key."""
    defaults: Mapping[str, Any]
    """Defaults of this command that differ from the options' defaults, by key."""

    def scenario(self) -> Scenario:
        """Return the file's scenario, or else the default scenario, changed by the given options.

        Raise ScenarioError if the file or an option is invalid, or a given option has no effect.
        """
        defaults = {key: value for key, value in self.defaults.items() if value is not None}
        return self.change(load_scenario(self.file) if self.file else Scenario(**defaults))

    def farm(self, name: str | None = None) -> FarmOptions | None:
        """Return the farm's options for a command whose farm is optional; None if no farm is given.

        Raise ScenarioError if options for reading a farm file are given without a farm.
        """
        name = self.changes.get("farm", name)
        how = [key for key in READS_FARM if key in self.changes]
        if name is None and how:
            flag = flag_of(how[0])
            msg = f"{flag} has an effect only with --farm: give --farm, too, or leave out {flag}"
            raise ScenarioError(msg)
        return None if name is None else replace(self.scenario().farm, name=name)

    def change(self, base: Scenario) -> Scenario:
        """Return `base` with the given options; ScenarioError if an option is invalid or has no effect."""
        chosen = scenario_with(base, {key: _own(key, value) for key, value in self.changes.items()})
        self._check_effects(chosen.to_dict(), is_fleet=len(chosen.vehicle.fleet) > 1)
        return chosen

    def _check_effects(self, values: Mapping[str, Any], *, is_fleet: bool) -> None:
        """Raise ScenarioError if an option that the user gave has no effect."""
        for given in (_defined(key) for key in self.changes):
            if given.needs and values[given.needs] == all_options()[given.needs][2].initial:
                raise ScenarioError(f"{given.flag} has an effect only with {flag_of(given.needs)}: give both")
            if given.needs_fleet and not is_fleet:
                alone = f"{given.flag} has an effect only with several vehicles"
                raise ScenarioError(f"{alone}: give --vehicles, or leave out {given.flag}")
            for other in given.not_with:
                if values[other] is not None:
                    with_what = f"{flag_of(other)} {values[other]}"
                    msg = f"{given.flag} has no effect with {with_what}: leave out one of the two"
                    raise ScenarioError(msg)


OF_DAYS = ("day", "days", "flights_per_day", "world")
"""Options of `FarmOptions` that concern days and the true development, not the farm's file."""
_NOT_OF_FILES = ("farm", "fields", *OF_DAYS)
READS_FARM = tuple(
    key for key in (held.key for held in options_of(FarmOptions).values()) if key not in _NOT_OF_FILES
)
"""Options for reading a farm file, which all commands that read a farm have."""
Command: TypeAlias = Callable[..., Any]


def taken_by(make: Callable[..., Any]) -> dict[str, tuple[Any, Any]]:
    """Return, by name, the annotation and default of each parameter of a callable."""
    taken = inspect.signature(make, eval_str=True).parameters
    return {name: (parameter.annotation, parameter.default) for name, parameter in taken.items()}


def gives(
    parameter: str,
    make: Callable[..., Any],
    options: Mapping[str, tuple[Any, Any]] | None = None,
    *,
    last: bool = False,
) -> Callable[[Command], Command]:
    """Replace a command's parameter by command-line options, from which ``make`` makes its value.

    `options` are annotations and defaults by name; by default they are the parameters of `make`, which may be
    a dataclass. The options come in the place of `parameter`; if `last`, they come at the end.
    """
    options = taken_by(make) if options is None else options

    def decorate(command: Command) -> Command:
        own = taken_by(command)
        if clash := options.keys() & own.keys():
            msg = f"{command.__name__}: part and command both have the options {', '.join(sorted(clash))}"
            raise TypeError(msg)

        @functools.wraps(command)
        def run(**values: Any) -> Any:
            made = make(**{name: values.pop(name) for name in options})
            return command(**{parameter: made}, **values)

        every: dict[str, tuple[Any, Any]] = {}
        for name, defined in own.items():
            every |= {name: defined} if name != parameter else {} if last else options
        every |= options
        run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [
                inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
                for name, (kind, default) in every.items()
            ]
        )
        run.__annotations__ = {name: kind for name, (kind, _) in every.items()}
        del run.__wrapped__
        return run

    return decorate


_JSON = Annotated[bool, option("Print one JSON document.", "--json", panel=OUTPUT_PANEL)]
_QUIET = Annotated[bool, option("Print no progress and no notes.", "--quiet", "-q", panel=OUTPUT_PANEL)]


def speaks(*, quiet: bool = True, json: Any = _JSON) -> Callable[[Command], Command]:
    """Add ``--json`` and, if `quiet`, ``--quiet`` to a command, which gets an `Output` as ``output``."""
    flags = {"json": (json, False), **({"quiet": (_QUIET, False)} if quiet else {})}

    def output(json: bool, quiet: bool = False) -> Output:
        return Output(as_json=json, quiet=quiet)

    return gives("output", output, flags, last=True)


def scenario_options(
    *parts: str,
    without: tuple[str, ...] = (),
    more: tuple[type[Part], ...] = (),
    defaults: Mapping[str, Any] = types.MappingProxyType({}),
) -> Callable[[Command], Command]:
    """Add the options of some parts of a scenario, ``--scenario`` and ``--seed`` to a command.

    `parts` are names of parts; ``--help`` lists their options in this order. The command's first
    parameter is named ``given`` and gets a `Given`. `without` has the keys of options to leave out
    (``scenario`` for ``--scenario``). `more` has parts that do not belong to `Scenario`. `defaults` has
    defaults that differ from those of the options (None for no default).
    """
    known = {
        str(defined.flag).removeprefix("--").replace("-", "_"): (part, defined)
        for part in (*map(PARTS.__getitem__, parts), Scenario, *more)
        for defined in _on_command_line(part)
        if not set(_keys(defined)) & set(without)
    }
    flags = {str(defined.flag) for _, defined in known.values()}

    def given(scenario: Path | None, **texts: Any) -> Given:
        changes: dict[str, Any] = {}
        others: dict[str, Any] = {}
        for name, (part, defined) in known.items():
            value = texts[name]
            if value is not None and value != []:
                read = value if defined.read is None else defined.read(value)
                (others if part in more else changes).update(read if defined.sets else {defined.key: read})
        return Given(scenario, changes, others, defaults)

    made = {name: (_annotation(defined, flags, defaults), None) for name, (_, defined) in known.items()}
    if "scenario" in without:
        return gives("given", partial(given, None), made)
    return gives("given", given, {**made, "scenario": (ScenarioFile, None)})


def _on_command_line(part: type[Any]) -> list[Option]:
    own = [defined for defined in options_of(part).values() if defined.flag is not None]
    return [*own, *(part.COMPOUND if issubclass(part, Part) else ())]


def _keys(defined: Option) -> tuple[str, ...]:
    return defined.sets or (defined.key,)


def flag_of(key: str) -> str:
    """Return the command-line flag that sets the option `key` of a run."""
    return str(_defined(key).flag)


def _defined(key: str) -> Option:
    """Return the last of the command-line options that set the option `key` of a run."""
    part = all_options()[key][0]
    return next(defined for defined in reversed(_on_command_line(part)) if key in _keys(defined))


def _annotation(defined: Option, flags: set[str], defaults: Mapping[str, Any]) -> Any:
    """Return the annotation of a command's parameter; `flags` has all flags of the command."""
    wanted = _command_line_type(defined)
    name, default = str(defined.flag), defaults.get(defined.key, defined.initial)
    if default is None and defined.key in defaults:
        default = "none"
    made = option(
        _help(defined, default, flags),
        f"{name}/--no-{name.removeprefix('--')}" if wanted is bool else name,
        panel=defined.panel,
        metavar=defined.metavar,
        parser=_READERS.get(wanted),
        autocompletion=complete(defined.kind) if defined.kind else None,
    )
    return Annotated[wanted | None, made]


def _command_line_type(defined: Option) -> Any:
    """Return an option's command-line type: list of str if repeatable, else int, float, bool or str."""
    wanted = defined.wanted
    kinds = [kind for kind in typing.get_args(wanted) if kind is not type(None)]
    if isinstance(wanted, types.UnionType):
        wanted = kinds[0] if len(kinds) == 1 else str
    if typing.get_origin(wanted) is dict or (typing.get_origin(wanted) is tuple and defined.read is None):
        return list[str]
    return wanted if wanted in (int, float, bool) else str


def _help(defined: Option, default: Any, flags: set[str]) -> str:
    """Return an option's help, with subject, range or unit, details, options it depends on, and default."""
    scale = defined.allowed if not (defined.choices or defined.read) else ""
    choices = f": {defined.allowed}" if defined.choices else ""
    depends, needs = "", (defined.needs,) if defined.needs and not defined.sets else ()
    for word, keys in (("only", needs), ("not", defined.not_with)):
        there = [flag for flag in (flag_of(key) for key in keys) if flag in flags]
        if there:
            depends = f" ({word} with {' or '.join(there)})"
    if isinstance(default, bool):
        default = f"{'' if default else 'no-'}{str(defined.flag).removeprefix('--')}"
    shown = defined.default or (
        "" if default is None else f"{default:g}" if isinstance(default, float) else default
    )
    range_or_unit = f", {scale}" if scale else f", {defined.unit}" if defined.unit else ""
    subject, more, rest = defined.help.partition("; ")
    text = f"{subject}{choices}{range_or_unit}{more}{rest}{depends}."
    return text + (f"  [default: {shown}]" if shown != "" else "")
