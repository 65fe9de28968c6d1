"""The command line of a run, made from the options of its parts.

`scenario_options` gives a command one option for each option of the parts that it uses; what each is called,
means, takes and defaults to stands in the part alone (`wbf_mission.scenario.parts`). Options that are no
part of a run (``--json``, ``--overwrite``) are here.
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
from wbf_mission.scenario.scenario import all_options

OUTPUT_PANEL = "Output"
CHECK_PANEL = "What is checked"


Number = TypeVar("Number", int, float)
Reader: TypeAlias = Callable[[str], Number]


def option(text: str, *names: str, panel: str | None = None, **more: Any) -> Any:
    """Return an option of the command line: what it is, its names, its heading; `more` is typer's."""
    return typer.Option(*names, help=text, rich_help_panel=panel, **more)


def complete(kind: str) -> Callable[[str], list[str]]:
    """Return what completes the names of a kind: farm, planner, estimator, autopilot or vehicle."""

    def names(incomplete: str) -> list[str]:
        from wbf_mission.scenario.choice import names_of

        return [name for name in names_of(kind) if name.startswith(incomplete)]

    return names


def _reader(parse: Callable[[str], Number], low: float | None = None, high: float = 0.0) -> Reader[Number]:
    """Return what reads an option's number, in a range if there is one; typer's own takes ``1_0`` for 10."""

    def read(text: str) -> Number:
        try:
            value = parse(str(text))
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
        if low is not None and not low <= value <= high:
            msg = f"{value} is out of range: give {low} to {high}"
            raise typer.BadParameter(msg)
        return value

    return read


number = _reader(parse_number)


def whole_number_in(low: int, high: int) -> Reader[int]:
    """Return a reader of whole numbers from `low` to `high`."""
    return _reader(parse_whole, low, high)


_READERS: Mapping[Any, Reader[Any]] = {int: _reader(parse_whole), float: number}

Jobs = Annotated[
    int, option("Processes at once; -1: one per core.", parser=whole_number_in(-1, 1024), min=-1, max=1024)
]


def require_processes(jobs: int) -> None:
    """Raise ScenarioError if no process is to work."""
    if jobs == 0:
        msg = "--jobs 0 runs nothing: give a number of processes, or -1 for one per core"
        raise ScenarioError(msg)


ScenarioFile = Annotated[
    Path | None,
    option("Scenario file (TOML); other options change it.", "--scenario", panel=RUN),
]
LINK_PANEL = "The vehicle's link"
LINKS = "udpin:, udpout:, tcp: or tcpin:HOST:PORT, or serial:DEVICE:BAUD."
"""The addresses of a link, for the help."""
Way = Literal["own", "mavsdk"]
"""Who talks to a vehicle behind a link."""
Via = Annotated[
    Way,
    option("MAVLink client: wbf-mission's own, or MAVSDK, which is independent of it.", panel=LINK_PANEL),
]
Wait = Annotated[
    float, option("Time to wait for the vehicle's heartbeat, s.", panel=LINK_PANEL, min=0.1, max=3600.0)
]
SystemId = Annotated[
    int | None,
    option(
        "System id of the vehicle, 1 to 255.  [default: the first one heard]",
        panel=LINK_PANEL,
        parser=whole_number_in(1, 255),
    ),
]


def link(what: str) -> Any:
    """Return the option ``--connect``."""
    return option(f"{what}: {LINKS}", panel=LINK_PANEL, metavar="LINK")


MISSION_SUFFIXES = (".plan", ".waypoints", ".wpl")
"""Of files that hold nothing but missions; a .json, .txt, .kml or .gpx may hold anything."""

Overwrite = Annotated[
    bool, option("Replace an existing output file, whatever its kind.", "--overwrite", panel=OUTPUT_PANEL)
]
"""Replaces files that are there; `Force` does not."""
Force = Annotated[
    bool, option("Go on despite errors that the preflight check finds.", "--force", panel=CHECK_PANEL)
]
"""Does what has errors; `Overwrite` does not."""


class TargetError(WbfMissionError, ValueError):
    """An output that would destroy a file, or that cannot be one."""


def refuse_overwrite(
    out: Path | None,
    inputs: Iterable[str | Path | None] = (),
    *,
    suffixes: tuple[str, ...] = (),
    overwrite: bool = False,
) -> None:
    """Raise TargetError if an output is one of the inputs, a file of another kind, a folder, or in no folder.

    Inputs that are no files are passed over. An existing file with another suffix than the command's (in
    lower case, if there are any) is somebody else's, and only replaced with `overwrite`; an input never is.

    >>> refuse_overwrite(Path("/dev/null"), ["miniberry-30", None])
    """
    if out is None:
        return
    if out.is_dir():
        msg = f"{out}: is a folder; give the name of a file"
        raise TargetError(msg)
    if not out.parent.is_dir():
        msg = f"{out}: there is no folder {out.parent}; make it, or give another name"
        raise TargetError(msg)
    if not out.exists():
        return
    # The name of a layer may follow that of a farm file.
    named = [Path(part) for one in inputs if one is not None for part in (one, str(one).partition("|")[0])]
    for given in named:
        if given.exists() and out.samefile(given):
            msg = f"{out}: this is the file that is read; give another name for the output"
            raise TargetError(msg)
    if not overwrite and suffixes and out.is_file() and out.suffix.lower() not in suffixes:
        kinds = " or ".join(one for one in suffixes if one)
        msg = f"{out}: a file that is already there and is no {kinds}; give another name, or --overwrite"
        raise TargetError(msg)


def _own(key: str, given: Any) -> Any:
    """Return what is meant by an option: what stands in a file of the user's, otherwise as it was given."""
    if key not in ("planner", "policy", "estimator") or not isinstance(given, str) or ".py:" not in given:
        return given
    from wbf_mission.own_code import own_choice

    return own_choice(given, key) or given


@dataclass(frozen=True, slots=True)
class Given:
    """What of a run was given on the command line."""

    file: Path | None
    """The scenario file."""
    changes: dict[str, Any]
    """Options of the scenario by their keys."""
    others: dict[str, Any]
    """Options of further parts (of the simulator) by their keys."""
    defaults: Mapping[str, Any]
    """What the command takes where nothing was given, if that is not the option's default."""

    def scenario(self) -> Scenario:
        """Return the run: the file's, without one the defaults, changed as was given.

        ScenarioError if the file or an option is wrong, or an option was given that has no effect.
        """
        defaults = {key: one for key, one in self.defaults.items() if one is not None}
        return self.change(load_scenario(self.file) if self.file else Scenario(**defaults))

    def farm(self, name: str | None = None) -> FarmOptions | None:
        """Return how the farm that is named is read, for a command that may do without; None if none is.

        ScenarioError if options are given that say how a farm is read, and no farm.
        """
        name = self.changes.get("farm", name)
        how = [key for key in READS_FARM if key in self.changes]
        if name is None and how:
            flag = _flag_of(how[0]).flag
            raise ScenarioError(f"{flag} has an effect only with --farm: give that, too, or leave it out")
        return None if name is None else replace(self.scenario().farm, name=name)

    def change(self, base: Scenario) -> Scenario:
        """Return a scenario with what was given; ScenarioError if part of that is wrong or has no effect."""
        chosen = scenario_with(base, {key: _own(key, one) for key, one in self.changes.items()})
        self._check_effects(chosen.to_dict(), is_fleet=len(chosen.vehicle.fleet) > 1)
        return chosen

    def _check_effects(self, values: Mapping[str, Any], *, is_fleet: bool) -> None:
        """Refuse what was given and has no effect, rather than fly something else than was meant."""
        for one in (_flag_of(key) for key in self.changes):
            if one.needs and values[one.needs] == all_options()[one.needs][2].initial:
                msg = f"{one.flag} has an effect only with {_flag_of(one.needs).flag}: give that, too"
                raise ScenarioError(msg)
            if one.needs_fleet and not is_fleet:
                msg = f"{one.flag} has an effect only with several vehicles: give --vehicles, or leave it out"
                raise ScenarioError(msg)
            for other in one.not_with:
                if values[other] is not None:
                    with_what = f"{_flag_of(other).flag} {values[other]}"
                    msg = f"{one.flag} has no effect with {with_what}: leave one of the two out"
                    raise ScenarioError(msg)


OF_DAYS = ("day", "days", "flights_per_day", "world")
"""The options of `FarmOptions` that say what happens on the farm."""
READS_FARM = tuple(
    one.key for one in options_of(FarmOptions).values() if one.key not in ("farm", "fields", *OF_DAYS)
)
"""The options that say how a farm's file is read, which every command has that reads one."""
Command: TypeAlias = Callable[..., Any]


def taken_by(make: Callable[..., Any]) -> dict[str, tuple[Any, Any]]:
    """Return the parameters of a callable: annotations and defaults by name."""
    taken = inspect.signature(make, eval_str=True).parameters
    return {name: (one.annotation, one.default) for name, one in taken.items()}


def gives(
    parameter: str,
    make: Callable[..., Any],
    options: Mapping[str, tuple[Any, Any]] | None = None,
    *,
    last: bool = False,
) -> Callable[[Command], Command]:
    """Give a command options in place of one of its parameters, which takes what `make` makes of them.

    The options, names with their annotation and default, are the parameters of `make` (a dataclass, say) if
    none are given. They stand where the parameter stands, or `last`.
    """
    options = taken_by(make) if options is None else options

    def decorate(command: Command) -> Command:
        own = taken_by(command)
        if clash := options.keys() & own.keys():
            msg = f"{command.__name__}: options {', '.join(sorted(clash))} stand in a part and in the command"
            raise TypeError(msg)

        @functools.wraps(command)
        def run(**values: Any) -> Any:
            made = make(**{name: values.pop(name) for name in options})
            return command(**{parameter: made}, **values)

        every: dict[str, tuple[Any, Any]] = {}
        for name, one in own.items():
            every |= {name: one} if name != parameter else {} if last else options
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
_QUIET = Annotated[bool, option("No progress, no notes.", "--quiet", "-q", panel=OUTPUT_PANEL)]


def speaks(*, quiet: bool = True, json: Any = _JSON) -> Callable[[Command], Command]:
    """Give a command ``--json`` and mostly ``--quiet``, and an `Output` by them as ``output``."""
    flags = {"json": (json, False), **({"quiet": (_QUIET, False)} if quiet else {})}

    def output(json: bool, quiet: bool = False) -> Output:
        return Output(as_json=json, quiet=quiet)

    return gives("output", output, flags, last=True)


def scenario_options(
    *parts: type[Any],
    without: tuple[str, ...] = (),
    more: tuple[type[Part], ...] = (),
    defaults: Mapping[str, Any] = types.MappingProxyType({}),
) -> Callable[[Command], Command]:
    """Give a command the options of some parts of a run, ``--scenario`` and ``--seed``.

    The first parameter of the command is called ``given`` and takes a `Given`. Options stand in ``--help`` in
    the order of the parts; `more` are parts that are no part of a `Scenario`, `without` keys that have no
    meaning for the command (``scenario`` among them), `defaults` those of this command that are not those of
    the options; None for nothing unless it is given.
    """
    known = {
        str(one.flag).removeprefix("--").replace("-", "_"): (part, one)
        for part in (*parts, Scenario, *more)
        for one in _on_command_line(part)
        if not set(_keys(one)) & set(without)
    }
    flags = {str(one.flag) for _, one in known.values()}

    def given(scenario: Path | None, **texts: Any) -> Given:
        changes: dict[str, Any] = {}
        others: dict[str, Any] = {}
        for name, (part, one) in known.items():
            value = texts[name]
            if value is not None and value != []:
                read = value if one.read is None else one.read(value)
                (others if part in more else changes).update(read if one.sets else {one.key: read})
        return Given(scenario, changes, others, defaults)

    made = {name: (_annotation(one, flags, defaults), None) for name, (_, one) in known.items()}
    if "scenario" in without:
        return gives("given", partial(given, None), made)
    return gives("given", given, {**made, "scenario": (ScenarioFile, None)})


def _on_command_line(part: type[Any]) -> list[Option]:
    own = [one for one in options_of(part).values() if one.flag is not None]
    return [*own, *(part.COMPOUND if issubclass(part, Part) else ())]


def _keys(one: Option) -> tuple[str, ...]:
    return one.sets or (one.key,)


def _flag_of(key: str) -> Option:
    """Return the option of the command line that sets an option of a run; the last where there are two."""
    part = all_options()[key][0]
    return next(one for one in reversed(_on_command_line(part)) if key in _keys(one))


def _annotation(one: Option, flags: set[str], defaults: Mapping[str, Any]) -> Any:
    """Return the annotation of a command's parameter; `flags` are all that the command has."""
    wanted = _command_line_type(one)
    name, default = str(one.flag), defaults.get(one.key, one.initial)
    if default is None and one.key in defaults:
        default = "none"
    made = option(
        _help(one, default, flags),
        f"{name}/--no-{name.removeprefix('--')}" if wanted is bool else name,
        panel=one.panel,
        metavar=one.metavar,
        parser=_READERS.get(wanted),
        autocompletion=complete(one.kind) if one.kind else None,
    )
    return Annotated[wanted | None, made]


def _command_line_type(one: Option) -> Any:
    """Return as what the command line takes an option: a list where it repeats, else a number or text."""
    wanted = one.wanted
    kinds = [kind for kind in typing.get_args(wanted) if kind is not type(None)]
    if isinstance(wanted, types.UnionType):
        wanted = kinds[0] if len(kinds) == 1 else str
    if typing.get_origin(wanted) is dict or (typing.get_origin(wanted) is tuple and one.read is None):
        return list[str]
    return wanted if wanted in (int, float, bool) else str


def _help(one: Option, default: Any, flags: set[str]) -> str:
    """Return the help of an option: its subject, range or unit, more on it, its dependence, the default."""
    scale = one.allowed if not (one.choices or one.read) else ""
    choices = f": {one.allowed}" if one.choices else ""
    depends = ""
    for word, keys in (("only", (one.needs,) if one.needs and not one.sets else ()), ("not", one.not_with)):
        there = [flag for flag in (str(_flag_of(key).flag) for key in keys) if flag in flags]
        if there:
            depends = f" ({word} with {' or '.join(there)})"
    if isinstance(default, bool):
        default = f"{'' if default else 'no-'}{str(one.flag).removeprefix('--')}"
    told = one.default or (
        "" if default is None else f"{default:g}" if isinstance(default, float) else default
    )
    range_or_unit = f", {scale}" if scale else f", {one.unit}" if one.unit else ""
    subject, more, rest = one.help.partition("; ")
    text = f"{subject}{choices}{range_or_unit}{more}{rest}{depends}."
    return text + (f"  [default: {told}]" if told != "" else "")
