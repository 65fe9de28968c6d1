"""Motion along S-curves under ArduPilot, with the transition from the present leg to a new route."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter import control as at
from sim_vehicle.motion.arducopter import scurve
from sim_vehicle.motion.arducopter.control import Guide, Law, Leg
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics
from sim_vehicle.motion.legs import LegKind

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.motion.columns import Record
    from sim_vehicle.motion.legs import Route

    Floats = NDArray[np.float64]

__all__ = ["AlongCurves"]

# A vehicle placed in flight joins its first leg if at least this fraction of its speed points along the leg.
# The leg began at most `_FAR_M` behind it, and the profile's speed may differ by `_SAME_M_S`.
_STEADY = 0.2
_FAR_M = 200.0
_SAME_M_S = 0.3
# Number of bisections that find a time; 24 bisections find it to 6 us on a leg of 100 s.
_HALVINGS = 24
# Indices into the result of `scurve.state_at`.
_POSITION, _SPEED = 0, 1


class AlongCurves(CompiledMotion):
    """Vehicle that ArduPilot guides along S-curves; generic dynamics fly commanded velocities."""

    generic: ClassVar[Dynamics]
    """Dynamics of the same vehicle without an autopilot."""
    begins_anew: ClassVar[LegKind]
    """Kind of leg that never continues the previous leg."""

    def _remember(self, columns: int) -> None:
        """Make an empty guidance memory; its array `guide` has `columns` elements."""
        self.guide: NDArray[np.float64] = np.zeros(columns)
        self.heads: NDArray[np.float64] = np.zeros((3, scurve.HEAD))
        self.curves: NDArray[np.float64] = np.zeros((3, scurve.SEGMENTS, scurve.COLUMNS))
        self._rows: Record | None = None
        self._under_way = self._interrupted = False

    @property
    def _dynamics_now(self) -> Dynamics:
        return self.generic if self._rows is None else self.dynamics

    def interrupt(self) -> None:
        """Abort the present leg; as in AC_WPNav, the next leg starts at the stopping point."""
        self._interrupted = True

    @property
    def _continues_leg(self) -> bool:
        """Whether the vehicle was placed in flight, and its first leg began behind it."""
        return self._under_way and not self._interrupted

    def _set_out(
        self, route: Route, law: Floats, points_m: Floats, kind: NDArray[Any], fastest: float
    ) -> None:
        """Begin a route with leg ends, kinds and a top speed that the vehicle's class chooses.

        Parameters
        ----------
        law : float64[LAW]
        """
        legs = route.legs
        speed = np.where(np.isnan(legs["speed"]), 0.0, np.minimum(legs["speed"], fastest))
        rest = (legs["heading"], legs["near"], kind, legs["pause"], legs["turn"])
        rows = np.column_stack((points_m, legs["radius"], speed, *rest))
        under_way, self._under_way = self._continues_leg, False
        self.guide[Guide.BEGINS] = self._join(rows[0], law) if under_way else self._follows(rows[0])
        self._rows = np.ascontiguousarray(rows).view(at.LEG)[:, 0]
        self._begin(self._rows)

    def _join(self, row: Floats, law: Floats) -> int:
        """Place the vehicle on a leg that began behind it, and return the transition to this leg."""
        guide, head, curve = self.guide, self.heads[1], self.curves[1]
        here, velocity = self.state[col.POSITION], self.state[col.VELOCITY]
        end = row[: Leg.Z + 1]
        left = math.sqrt(((end - here) ** 2).sum())
        speed = math.sqrt((velocity**2).sum())
        along = float((velocity * (end - here)).sum()) / left if left > 0.0 else 0.0
        if int(row[Leg.KIND]) not in (LegKind.WAYPOINT, LegKind.HOME) or along < _STEADY * max(speed, 0.5):
            return at.ANEW
        guide[Guide.LEVEL] = row[Leg.SPEED] if row[Leg.SPEED] >= at.LEAST_SPEED else guide[Guide.LEVEL]
        guide[Guide.UP], guide[Guide.DOWN] = law[Law.SPEED_UP], law[Law.SPEED_DOWN]
        ahead = (end - here) / left
        _make_leg(guide, law, head, curve, ahead * (_FAR_M + left))
        at_s = _time_of(head, curve, _POSITION, _FAR_M, scurve.end_time(head, curve))
        behind = _FAR_M
        if scurve.state_at(head, curve, at_s)[1] > along + _SAME_M_S:
            # The vehicle is still accelerating, so the leg began behind it by the distance flown since.
            at_s = _time_of(head, curve, _SPEED, along, 0.5 * scurve.end_time(head, curve))
            behind = scurve.state_at(head, curve, at_s)[0]
            _make_leg(guide, law, head, curve, ahead * (behind + left))
            at_s = _time_of(head, curve, _POSITION, behind, scurve.end_time(head, curve))
        _, speed, acceleration = scurve.state_at(head, curve, at_s)
        head[scurve.TIME] = at_s
        guide[Guide.BEGIN_X : Guide.BEGIN_X + 3] = here - ahead * behind
        guide[Guide.END_X : Guide.END_X + 3] = end
        guide[Guide.PX : Guide.PX + 3] = here
        guide[Guide.VX : Guide.VX + 3] = ahead * speed
        guide[Guide.AX : Guide.AX + 3] = ahead * acceleration
        guide[Guide.MODE] = at.LEGS
        guide[Guide.RESET] = guide[Guide.PACE] = 1.0
        return at.SAME

    def _follows(self, row: Floats) -> int:
        """Return the transition from the present leg to the leg `row`."""
        interrupted, self._interrupted = self._interrupted, False
        if self._rows is None or row[Leg.KIND] == self.begins_anew:
            return at.ANEW
        guide, target, arrived = self.guide, row[: Leg.Z + 1], bool(self.counters[col.ARRIVED])
        chained = guide[Guide.BEGINS] == at.CHAINED
        if interrupted and not (chained or arrived):
            return at.ANEW
        end = guide[Guide.END_X : Guide.END_X + 3]
        if chained and guide[Guide.FAST] != 0.0:
            head = self.heads[2]
            ahead = end + head[scurve.LENGTH] * head[scurve.UX : scurve.UZ + 1]
            return at.CHAINED if np.allclose(ahead, target, rtol=0.0, atol=1e-3) else at.ANEW
        if chained or arrived:
            return at.CHAINED
        if guide[Guide.MODE] == at.LEGS and np.allclose(end, target, rtol=0.0, atol=1e-3):
            return at.SAME
        return at.ANEW


def _make_leg(guide: Floats, law: Floats, head: Floats, curve: Floats, way: Floats) -> None:
    """Make the profile of a leg at the present speed limits."""
    east, north, up = way.tolist()
    scurve.make_leg(
        head,
        curve,
        (east, north, up),
        (float(guide[Guide.LEVEL]), float(guide[Guide.UP]), float(guide[Guide.DOWN])),
        (float(law[Law.ACCEL]), float(law[Law.ACCEL_Z])),
        law[Law.SNAP],
        law[Law.JERK],
    )


def _time_of(head: Floats, curve: Floats, which: int, value: float, end_s: float) -> float:
    """Return the time at which the rising position or speed of the profile reaches `value`."""
    low, high = 0.0, end_s
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if scurve.state_at(head, curve, middle)[which] < value:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
