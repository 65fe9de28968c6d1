"""How the vehicles of a fleet keep apart."""

from __future__ import annotations

from dataclasses import dataclass

from geo.texts import parse_number
from wbf_mission.scenario.option import ScenarioError

LAYERS, DISTANCE, NOTHING = "layers", "distance", "none"
_LEAST_M, _MOST_M = 0.5, 100.0


@dataclass(frozen=True, slots=True)
class Separation:
    """How vehicles keep apart.

    Parameters
    ----------
    kind : {"layers", "distance", "none"}
        Each flies at a height of its own; or all fly at one height and keep a distance in time; or they do
        not care.
    metres : float
        Between two layers, or between two vehicles.
    """

    kind: str
    metres: float = 0.0


def parse_separation(text: str) -> Separation:
    """Read ``layers:2m``, ``distance:5m`` or ``none``.

    Raises
    ------
    ScenarioError
        If it is none of these, or the distance is not 0.5 to 100 m.

    Examples
    --------
    >>> parse_separation("layers:2m")
    Separation(kind='layers', metres=2.0)
    """
    kind, colon, rest = text.strip().lower().partition(":")
    if kind == NOTHING and not colon:
        return Separation(NOTHING)
    try:
        metres = parse_number(rest.strip().removesuffix("m").strip())
    except ValueError:
        metres = 0.0
    if kind not in (LAYERS, DISTANCE) or not _LEAST_M <= metres <= _MOST_M:
        msg = (
            f"separation {text!r} is not understood: give layers:METRES or distance:METRES with"
            f" {_LEAST_M:g} to {_MOST_M:g} m, such as layers:2m, or none"
        )
        raise ScenarioError(msg)
    return Separation(kind, metres)
