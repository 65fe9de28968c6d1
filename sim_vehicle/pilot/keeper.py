"""What a pilot knows and keeps, below the modes: the vehicle, its plans, its parameters, its notices."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from geo.frame import LocalFrame
from mission.model import Command, MissionItem
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.failsafe_rules import FailsafeRules
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor, check_mission
from sim_vehicle.execution.items import item_places
from sim_vehicle.execution.state import LandedState, Phase, VehicleState
from sim_vehicle.pilot.fence import Fence
from sim_vehicle.pilot.modes import Outcome
from sim_vehicle.pilot.notices import MissionState, Notice, RefusedError, Severity
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from sim_vehicle.pilot.failsafe import Failsafe

__all__ = ["Keeper"]


class Keeper:
    """The inner part of `sim_vehicle.pilot.pilot.Pilot`."""

    failsafe: Failsafe

    def __init__(
        self,
        spec: VehicleSpec,
        frame: LocalFrame,
        *,
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
        mode: Mode = Mode.HOLD,
        takes_off: bool = False,
        rules: FailsafeRules,
        epoch_unix_s: float | None = None,
    ) -> None:
        self.spec = spec
        self.frame = frame
        self.parameters = RuntimeParameters.of(spec)
        for name, value in rules.defaults.items():
            setattr(self.parameters, name, value)
        self.mode = mode
        self.outcome = Outcome.RUNNING
        self.outcome_text = ""
        self.position_ok = True
        self.motor_ok = True
        self.arming_block: str | None = None
        self.now_s = 0.0
        self.executor = MissionExecutor(spec, frame, wind=wind, yaw_rad=yaw_rad)
        self.executor.takes_off = takes_off
        if epoch_unix_s is not None:
            self.executor.epoch_unix_s = epoch_unix_s
        self.state: VehicleState = self.executor.state()
        self._notices: list[Notice] = []
        self._problems: tuple[str, ...] = ()
        self._started = False
        self._complete = False

    @property
    def armed(self) -> bool:
        """Whether the motors run."""
        return self.executor.armed

    @property
    def landed(self) -> LandedState:
        """Ground contact."""
        return self.state.landed

    @property
    def home_m(self) -> tuple[float, float]:
        """Where home is, east and north of the start."""
        return self.executor.home_m

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The mission."""
        return self.executor.items

    @property
    def mission_size(self) -> int:
        """Items of the mission."""
        return len(self.executor.items)

    @property
    def current_seq(self) -> int:
        """The mission item that is flown now or next."""
        return max(0, self.executor.current_seq)

    @property
    def mission_state(self) -> MissionState:
        """Progress of the mission."""
        if not self.executor.items or self._problems:
            return MissionState.NO_MISSION
        if self._complete:
            return MissionState.COMPLETE
        if not self._started:
            return MissionState.NOT_STARTED
        flying = self.mode is Mode.MISSION and self.armed and self.state.phase is not Phase.HOLD
        return MissionState.ACTIVE if flying else MissionState.PAUSED

    def notices(self) -> list[Notice]:
        """Return what was noted since the last call."""
        taken, self._notices = self._notices, []
        return taken

    def note(self, severity: Severity, text: str) -> None:
        """Tell the operator."""
        self._notices.append(Notice(severity, text))

    def why_no_mission(self) -> str | None:
        """Return why the mission cannot be flown, None when it can."""
        if not self.executor.items:
            return "no mission"
        return self._problems[0] if self._problems else None

    def reject_mission(self, reason: str) -> None:
        """Note that a mission was refused in its transfer; the old one stays in force."""
        if not self.armed:
            self.end(Outcome.MISSION_REJECTED, reason)

    def set_fence(self, items: Sequence[MissionItem]) -> None:
        """Replace the fence; a mission that is not flown now is judged again."""
        any_inclusion = self.failsafe.rules.any_inclusion
        self.failsafe.set_fence(Fence.of(items, self.frame, any_inclusion=any_inclusion))
        self._judge_again()

    def set_rally(self, items: Sequence[MissionItem]) -> None:
        """Replace the rally points, which are returned to when they are nearer than home."""
        places = item_places([item for item in items if item.command == Command.NAV_RALLY_POINT], self.frame)
        self.executor.rally_m = tuple(place for place in places if not math.isnan(place[0]))

    def set_home(self, latitude_deg: float, longitude_deg: float) -> None:
        """Move home; its altitude stays that of the ground. RefusedError too far from the start."""
        x_m, y_m = self.frame.from_wgs84(latitude_deg, longitude_deg)
        if not math.hypot(x_m, y_m) <= self.spec.max_distance_m:
            msg = f"Home refused: more than {self.spec.max_distance_m:.0f} m from the start"
            raise RefusedError(msg, denied=True)
        self.executor.home_m = (x_m, y_m)
        self.failsafe.apply_parameters()

    def _judge(self, items: Sequence[MissionItem]) -> None:
        """Find what in a mission cannot be flown."""
        self._problems = ()
        if items:
            problems = check_mission(
                items,
                self.frame,
                self.spec,
                needs_takeoff=not self.executor.takes_off,
                outside=self.failsafe.outside if self.failsafe.fence_enabled else None,
            )
            self._problems = tuple(problems)

    def _judge_again(self) -> None:
        items = self.executor.items
        if not items or (self.armed and self.mode is Mode.MISSION):
            return
        before = self._problems
        self._judge(items)
        if self._problems and self._problems != before:
            self.note(Severity.CRITICAL, f"Mission rejected: {self._problems[0]}")

    def look_at(self, latitude_deg: float | None, longitude_deg: float = 0.0) -> None:
        """Point the nose at a place whatever is flown, None for no more."""
        place = None if latitude_deg is None else self.frame.from_wgs84(latitude_deg, longitude_deg)
        self.executor.look_at(place)

    def place_of(
        self, latitude_deg: float, longitude_deg: float, altitude_m: float, *, relative: bool
    ) -> tuple[float, float, float]:
        """Return east, north, up about the start of a place."""
        x_m, y_m = self.frame.from_wgs84(latitude_deg, longitude_deg)
        return x_m, y_m, altitude_m - (0.0 if relative else self.frame.altitude_m)

    def drain_battery(self, fraction: float) -> None:
        """Leave no more than this fraction of its capacity in the battery."""
        self.executor.drain_battery(fraction)
        self.state = self.executor.state()

    def on_gcs_heartbeat(self, now_s: float) -> None:
        """Note a heartbeat of a ground station, of which the link-loss failsafe counts the silence."""
        self.failsafe.on_gcs_heartbeat(now_s)

    def apply_parameters(self) -> None:
        """Take the values of `parameters`."""
        parameters = self.parameters
        self.spec = replace(
            self.spec,
            cruise_speed_m_s=parameters.cruise_speed_m_s,
            acceptance_radius_m=parameters.acceptance_radius_m,
            takeoff_altitude_m=parameters.takeoff_altitude_m,
            return_altitude_m=parameters.return_altitude_m,
            landing_speed_m_s=parameters.landing_speed_m_s,
            disarm_delay_s=parameters.disarm_delay_s,
        )
        self.spec = with_autopilot(self.spec, self.spec.autopilot, parameters.settings)
        self.executor.update_spec(self.spec)
        self.failsafe.apply_parameters()
        self._judge_again()

    def _command(self, order: Callable[[], None]) -> None:
        """Give the executor an order; what it refuses is refused here."""
        try:
            order()
        except RefusedError:
            raise
        except VehicleError as error:
            raise RefusedError(str(error)) from None
        self.state = self.executor.state()

    def end(self, outcome: Outcome, reason: str) -> None:
        """Note how the run ended."""
        self.outcome = outcome
        self.outcome_text = reason
