"""Options of ``wbf-mission sim``, from the command line or a scenario file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from geo.texts import one_line, parse_number, unknown
from wbf_mission.scenario import Scenario, ScenarioError, read_table, scenario_from_table, take_faults
from wbf_mission.scenario.option import Part, option, options_of
from wbf_mission.scenario.parts import CAMERA, VEHICLE

if TYPE_CHECKING:
    from sim_vehicle.host.injection import AnyFault

LINKS = "Links and time"
_BOOTS = ("warm", "cold")
_RATES = ("light", "sitl")
_SLOWEST, _FASTEST = 0.01, 10_000.0


@dataclass(frozen=True, slots=True)
class SimOptions(Part):
    """Options of the simulator that are not part of a scenario; the table ``[sim]`` of a file."""

    count: int | None = option(
        None,
        "Number of vehicles; each is a MAVLink system with its own ports",
        VEHICLE,
        low=1,
        high=250,
        default="one for each home",
    )
    system_id: int = option(
        1, "System id of the first vehicle; further vehicles get the next ids", VEHICLE, low=1, high=250
    )
    home: tuple[str, ...] = option(
        (),
        "Home LAT,LON[,ALT[,HEADING]]: degrees, metres above sea level, degrees; once for all vehicles,"
        " or once for each",
        VEHICLE,
        default="the farm's home",
        metavar="LAT,LON",
    )
    boot: str = option(
        "warm",
        "Autopilot at the start: warm (up and ready to arm) or cold (boots at first contact and is ready"
        " to arm about 40 s later; ArduCopter)",
        VEHICLE,
        metavar="KIND",
    )
    spacing_m: float = option(
        4.0, "Distance between vehicles that share a home", VEHICLE, low=0.0, high=1000.0
    )
    listen: tuple[str, ...] = option(
        (),
        "Link for ground stations, to all vehicles: udpin:, udpout: or tcpin:HOST:PORT, or"
        " serial:DEVICE:BAUD; may be repeated",
        LINKS,
        default="the autopilot's own simulator ports",
        metavar="URL",
    )
    connect: tuple[str, ...] = option(
        (),
        "Link that the simulator opens: udpout:HOST:PORT or tcp:HOST:PORT; may be repeated",
        LINKS,
        default="none",
        metavar="URL",
    )
    rates: str = option(
        "light",
        "Telemetry: light (few messages) or sitl (messages and rates of the autopilot's own simulator, on"
        " each of its links)",
        LINKS,
        metavar="KIND",
    )
    speed: float | str = option(
        1.0, "Pace: simulated seconds per second of wall time, or max", LINKS, metavar="FACTOR"
    )
    duration_s: float | None = option(
        None,
        "Simulated time after which the simulator stops",
        LINKS,
        default="until Ctrl-C",
    )
    camera: bool | None = option(
        None,
        "Simulate a leaf camera on each vehicle, as a MAVLink component of its own",
        CAMERA,
        default="camera; with ArduPilot, no-camera unless a camera option is given",
    )

    def check(self) -> None:
        """Raise ScenarioError for an invalid speed, duration, rate or kind of boot."""
        for key, given, known in (("boot", self.boot, _BOOTS), ("rates", self.rates, _RATES)):
            if given not in known:
                msg = f"{key} {one_line(str(given), 40)!r} is unknown: give {' or '.join(known)}"
                raise ScenarioError(msg)
        parse_speed(self.speed)
        if self.duration_s is not None and not 0.0 < self.duration_s < 1e9:
            msg = f"duration {self.duration_s} is out of range: give a positive number of simulated seconds"
            raise ScenarioError(msg)


def parse_speed(speed: float | str) -> float:
    """Return a speed as a number; "max" is infinity.

    Examples
    --------
    >>> parse_speed("max"), parse_speed("2.5")
    (inf, 2.5)
    """
    if isinstance(speed, str) and speed.strip().lower() == "max":
        return math.inf
    try:
        number = parse_number(speed) if isinstance(speed, str) else float(speed)
    except ValueError:
        number = math.nan
    if not _SLOWEST <= number <= _FASTEST:
        msg = f"speed {speed} is out of range: give {_SLOWEST:g} to {_FASTEST:g} (1 is real time), or max"
        raise ScenarioError(msg)
    return number


def load_sim(path: str | Path) -> tuple[Scenario, SimOptions, tuple[AnyFault, ...]]:
    """Read a simulator's scenario file: keys of a scenario, a table ``[sim]`` and tables ``[[fault]]``."""
    path = Path(path)
    table = read_table(path)
    faults = take_faults(table, path)
    given = table.pop("sim", {})
    scenario = scenario_from_table(table, path)
    if not isinstance(given, dict):
        msg = f"{path}: sim must be a table: write it as [sim]"
        raise ScenarioError(msg)
    known = list(options_of(SimOptions))
    wrong = [key for key in given if key not in known]
    try:
        if wrong:
            raise ScenarioError(f"[sim]: {unknown('key', wrong[0], known)}")
        return scenario, SimOptions(**given), faults
    except ScenarioError as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error
