"""Prediction of the time, energy and path of missions, with the executor and motion of the simulator."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.airframe.navigation_errors import EstimateErrors
from sim_vehicle.autopilot import estimate_errs
from sim_vehicle.execution.state import EPOCH_UNIX_S
from sim_vehicle.prediction.flight import Prediction, fly_all

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from geo.frame import LocalFrame
    from mission.model import Mission
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.prediction.flight import Air, PredictedFlight
    from sim_vehicle.weather.wind import Wind

_TRACK_STEP_S = 1.0
_TRACK_POINTS = 600  # Minimum number of steps in a plan's track, so that it shows the corners of short plans.
_FINEST_STEP_S = 0.1
_REHEARSAL_SEED = 0x1D8F
_ERROR_SEED = 0x4A7C
ERROR_REHEARSALS = 8
"""Number of samples of the estimate errors in `expected_flights`."""
REHEARSAL_PAIRS = 2
"""Number of pairs of opposite gusts with which candidate flights are compared."""
PREDICTION_PAIRS = 8
"""Number of pairs for the chosen flight; larger, since gusts' effects on power do not cancel in a pair."""
BOUND_PROBABILITY = 0.995
"""Probability that one flight needs at most `Prediction.energy_bound_wh`."""


def predict_flight(
    mission: Mission,
    spec: VehicleSpec,
    *,
    wind: Wind | None = None,
    frame: LocalFrame | None = None,
    track_step_s: float = _TRACK_STEP_S,
    epoch_unix_s: float = EPOCH_UNIX_S,
    endless: bool = False,
) -> Prediction:
    """Predict a flight of the mission from home.

    The prediction uses the simulated vehicle, so duration, energy and length are those of an undisturbed
    flight in the same wind. The prediction does not include failsafes that end a flight early.

    Parameters
    ----------
    frame : LocalFrame, optional
        Frame with its origin at home; by default, home is the mission's home, or else its first position.
    track_step_s : float
        Time step of the track, rounded to tenths of a second (for the ideal vehicle, to its time step).
    epoch_unix_s : float
        Unix time at the start, for items that wait for a time of day.
    endless : bool
        Whether the vehicle flies on with an empty battery, so that the whole mission is predicted.

    Raises
    ------
    VehicleError
        If neither ``frame`` nor the mission defines home, or ``track_step_s`` is not positive.

    Examples
    --------
    >>> from mission.model import GeoPoint, Mission, MissionItem
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> takeoff = MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0)
    >>> there = MissionItem.waypoint(28.051, -82.15, 10.0)
    >>> flight = predict_flight(Mission((takeoff, there), GeoPoint(28.05, -82.15)), get_vehicle("quad"))
    >>> flight.feasible, 115.0 < flight.path_length_m < 122.0
    (True, True)
    """
    (flights,) = fly_all(
        [mission], spec, [(wind, None)], frame, track_step_s, epoch_unix_s=epoch_unix_s, endless=endless
    )
    return flights[0].prediction()


def predict_flights(
    missions: Sequence[Mission], spec: VehicleSpec, *, wind: Wind | None = None
) -> list[Prediction]:
    """Predict the flights of several missions together, in threads on all cores.

    Each prediction equals the result of `predict_flight` to the last bit.
    """
    flown = fly_all(missions, spec, [(wind, None)], None, _TRACK_STEP_S)
    return [flight.prediction() for (flight,) in flown]


def expected_flights(
    missions: Sequence[Mission],
    spec: VehicleSpec,
    *,
    wind: Wind | None = None,
    frame: LocalFrame | None = None,
    track_step_s: float = _TRACK_STEP_S,
    endless: bool = False,
    estimate_errors: bool = False,
    pairs: int = REHEARSAL_PAIRS,
) -> list[Prediction]:
    """Predict flights in a wind with gusts that are known only statistically.

    In a wind without gusts, the predictions equal the result of `predict_flights`. Otherwise each mission is
    flown in `pairs` pairs of winds from `rehearsals`. Duration, energy and length are means over these
    flights, and so include what gusts cost in time and power. The track is from the flight whose energy is
    nearest to the mean. A mission is infeasible if at most half of its flights complete it.

    With `estimate_errors`, the means are also over the errors of PX4's estimate
    (`sim_vehicle.airframe.navigation_errors`); there are then at least `ERROR_REHEARSALS` flights. Each
    flight has its own errors, which are the same in every call. The estimates of other autopilots are exact.
    """
    airs = _rehearsed_airs(spec, wind, pairs, estimate_errors=estimate_errors)
    flown = fly_all(missions, spec, airs, frame, track_step_s, endless=endless)
    return [_mean_prediction(flights) for flights in flown]


def rehearsed_tracks(
    mission: Mission,
    spec: VehicleSpec,
    *,
    wind: Wind | None = None,
    track_step_s: float = _TRACK_STEP_S,
    estimate_errors: bool = False,
) -> list[NDArray[np.float64]]:
    """Return the tracks, float64[n, 3], of the flights that `expected_flights` averages for a mission."""
    airs = _rehearsed_airs(spec, wind, REHEARSAL_PAIRS, estimate_errors=estimate_errors)
    (flights,) = fly_all([mission], spec, airs, None, track_step_s, endless=True)
    return [flight.prediction().track_m for flight in flights]


def _rehearsed_airs(spec: VehicleSpec, wind: Wind | None, pairs: int, *, estimate_errors: bool) -> list[Air]:
    """Return the winds of the flights, each with the errors of the estimate; None for an exact estimate."""
    winds = rehearsals(wind, pairs)
    if not (estimate_errors and estimate_errs(spec)):
        return [(air, None) for air in winds]
    errors = [
        EstimateErrors(np.random.SeedSequence(_ERROR_SEED, spawn_key=(k,)))
        for k in range(max(ERROR_REHEARSALS, len(winds)))
    ]
    return [(winds[k % len(winds)], wrong) for k, wrong in enumerate(errors)]


def plan_prediction(
    mission: Mission,
    spec: VehicleSpec,
    *,
    wind: Wind | None = None,
    frame: LocalFrame | None = None,
    estimate_errors: bool = False,
) -> Prediction:
    """Predict the flight of a plan for the reports of planning, preflight check and flight.

    The prediction is from `expected_flights` with `PREDICTION_PAIRS` pairs. The track has steps of 0.1 to
    1 s, and at least 600 steps for flights longer than a minute, because the coverage is computed from the
    track. If the battery does not last, duration, energy, length and track are for the whole mission with an
    unlimited battery. The reason then says when the battery reaches its reserve and when it is empty.
    """

    def flown(*, endless: bool, track_step_s: float) -> Prediction:
        return expected_flights(
            [mission],
            spec,
            wind=wind,
            frame=frame,
            endless=endless,
            estimate_errors=estimate_errors,
            pairs=PREDICTION_PAIRS,
            track_step_s=track_step_s,
        )[0]

    def expected(*, endless: bool) -> Prediction:
        found = flown(endless=endless, track_step_s=_TRACK_STEP_S)
        step_s = max(_FINEST_STEP_S, found.duration_s / _TRACK_POINTS)
        return found if step_s >= _TRACK_STEP_S else flown(endless=endless, track_step_s=step_s)

    limited, battery = expected(endless=False), spec.battery
    if battery is None or limited.battery_fraction >= battery.reserve_fraction:
        return limited
    one_wind = rehearsals(wind)[0]
    if not predict_flight(mission, spec, wind=one_wind, frame=frame, endless=True).feasible:
        return limited  # The mission fails even with an unlimited battery.
    whole = limited if limited.battery_fraction > 0.0 else expected(endless=True)

    def lasts(watt_hours: float) -> str:
        smaller = replace(spec, battery=replace(battery, capacity_wh=watt_hours))
        flight = predict_flight(mission, smaller, wind=one_wind, frame=frame)
        return _clock(min(flight.duration_s, whole.duration_s))

    usable_wh = battery.capacity_wh * (1.0 - battery.reserve_fraction)
    reason = (
        f"the whole mission takes {_clock(whole.duration_s)} and {whole.energy_wh:.1f} Wh, but the battery of"
        f" {battery.capacity_wh:g} Wh is at its reserve of {battery.reserve_fraction:.0%}"
        f" after {lasts(usable_wh)}"
    )
    if whole.energy_wh > battery.capacity_wh:
        reason += f" and empty after {lasts(battery.capacity_wh)}"
    return replace(
        whole,
        battery_fraction=min(whole.battery_fraction, limited.battery_fraction),
        feasible=False,
        reason=reason,
    )


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def _mean_prediction(flights: Sequence[PredictedFlight]) -> Prediction:
    """Return the expected result of a mission from its flights in several winds."""
    predictions = [flight.prediction() for flight in flights]
    done = [prediction for prediction, flight in zip(predictions, flights, strict=True) if flight.completed]
    if len(done) == 1 == len(flights):
        return done[0]
    if 2 * len(done) <= len(flights):
        return next(
            prediction
            for prediction, flight in zip(predictions, flights, strict=True)
            if not flight.completed
        )
    energy_wh = sum(flown.energy_wh for flown in done) / len(done)
    battery_fraction, reason = flights[0].left(energy_wh)
    duration_s = sum(flown.duration_s for flown in done) / len(done)
    energies_wh = [flown.energy_wh for flown in done]
    bound = _interval(energy_wh, energies_wh, BOUND_PROBABILITY)
    typical = min(done, key=lambda flown: abs(flown.energy_wh - energy_wh))
    return replace(
        typical,
        duration_s=duration_s,
        energy_wh=energy_wh,
        battery_fraction=battery_fraction,
        path_length_m=sum(flown.path_length_m for flown in done) / len(done),
        feasible=not reason,
        reason=reason,
        duration_interval_s=_interval(duration_s, [flown.duration_s for flown in done]),
        energy_interval_wh=_interval(energy_wh, energies_wh),
        energy_bound_wh=None if bound is None else bound[1],
    )


def _interval(mean: float, values: Sequence[float], side: float = 0.95) -> tuple[float, float] | None:
    """Return the two bounds of a further value, each violated with probability ``1 - side`` (Student's t)."""
    from scipy.special import stdtrit

    count = len(values)
    if count < 2:
        return None
    variance = sum((value - mean) ** 2 for value in values) / (count - 1)
    half = float(stdtrit(count - 1, side)) * math.sqrt(variance * (1.0 + 1.0 / count))
    return mean - half, mean + half


def rehearsals(wind: Wind | None, pairs: int = REHEARSAL_PAIRS) -> list[Wind | None]:
    """Return winds for predicted flights if only the statistics of the wind are known.

    The winds have the mean, shear and gust statistics of `wind`, but their own gusts, which do not depend on
    the seed of `wind`. Two winds of a pair have opposite gusts. Effects that are linear in the gust therefore
    cancel in the mean, and few flights suffice (antithetic variates; Hammersley and Morton 1956). If the wind
    is steady, it is returned alone.
    """
    if wind is None or not wind.is_gusty:
        return [wind]
    seeds = [np.random.SeedSequence(_REHEARSAL_SEED, spawn_key=(k,)) for k in range(pairs)]
    return [replace(wind, seed=seed, mirrored=mirrored) for seed in seeds for mirrored in (False, True)]
