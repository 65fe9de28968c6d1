"""How much of the planned legs the predicted flight follows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from wbf_mission.preflight.checks.legs import Leg
from wbf_mission.preflight.subject import Subject

__all__ = ["share_flown"]

_STEP_M = 0.5
_MOST_POINTS = 20_000


def share_flown(subject: Subject, legs: Sequence[Leg], within_m: float) -> float | None:
    """Return which part of the length of legs the vehicle passes at no more than a distance, over ground.

    Parameters
    ----------
    subject : Subject
    legs : sequence of Leg
    within_m : float

    Returns
    -------
    float or None
        From 0 to 1, of the flight that follows them least; None without a predicted flight.
    """
    tracks = [track.points_m[:, :2] for track in subject.tracks if len(track.points_m) > 1]
    lengths_m = np.array([leg.length_m for leg in legs])
    if not tracks or not lengths_m.any():
        return None
    starts = np.array([leg.start_m[:2] for leg in legs])
    ends = np.array([leg.end_m[:2] for leg in legs])
    step_m = max(_STEP_M, float(lengths_m.sum()) / _MOST_POINTS)
    counts = np.maximum(np.ceil(lengths_m / step_m), 1).astype(np.int64)
    of_leg = np.repeat(np.arange(len(legs)), counts)
    along = (np.arange(len(of_leg)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[of_leg]
    points = shapely.points(starts[of_leg] + along[:, None] * (ends - starts)[of_leg])
    weights = (lengths_m / counts)[of_leg]
    shares = []
    for track in tracks:
        flown = shapely.STRtree(shapely.linestrings(np.stack((track[:-1], track[1:]), axis=1)))
        near = np.unique(flown.query(points, predicate="dwithin", distance=within_m)[0])
        shares.append(float(weights[near].sum() / weights.sum()))
    return min(shares)
