"""The link to a vehicle that flies a run's mission."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mission.transfer.vehicles import Vehicle as HeardVehicle
from wbf_mission.fleet import Vehicle
from wbf_mission.ground.link import find_vehicle
from wbf_mission.hosting import Hosting
from wbf_mission.joint_flight import Attendant
from wbf_mission.live.discovery import fitted_to, require_single_flight
from wbf_mission.live.via import OwnVia, Via
from wbf_mission.planning import PlanResult
from wbf_mission.preflight.finding import Concern
from wbf_mission.preflight.run import Circumstances, Tell, check_mission, tell_nobody
from wbf_mission.preflight.vehicle.asking import ask_vehicle
from wbf_mission.scenario import Scenario

__all__ = ["LiveLink"]


def _silent(_text: str) -> None:
    """Tell nobody."""


@dataclass(slots=True)
class LiveLink:
    """A vehicle behind a link, and who stands by while it flies.

    Parameters
    ----------
    url : str
        ``udpin:``, ``udpout:``, ``tcp:`` or ``tcpin:HOST:PORT``, or ``serial:DEVICE:BAUD``.
    attendant : Attendant
    agreed : bool
        The start of the motors is agreed to beforehand.
    wait_s : float
        How long to wait for the vehicle's heartbeat.
    system_id : int or None
        Of the vehicle; None: the first one that is heard.
    note : callable
        Takes lines for the operator.
    force : bool
        Fly a plan in which the preflight check finds errors, among them what the autopilot would refuse.
    tell : callable
        Takes what the preflight check finds, and the error with which the flight is refused, if it is.
    via : Via
        Who talks to the vehicle.
    """

    url: str
    attendant: Attendant
    agreed: bool = False
    wait_s: float = 10.0
    system_id: int | None = None
    note: Callable[[str], None] = _silent
    force: bool = False
    tell: Tell = tell_nobody
    via: Via = field(default_factory=OwnVia)
    _heard: HeardVehicle | None = field(default=None, init=False)

    def fitted(self, scenario: Scenario) -> Scenario:
        """Wait for the vehicle; return the scenario by the rules of its autopilot.

        Raises
        ------
        LiveFlightError
            If this vehicle cannot do the run.
        LinkError, NoVehicleError
            If there is no link, or nobody on it.
        """
        require_single_flight(scenario)
        self._heard = find_vehicle(
            self.url,
            wait_s=self.wait_s,
            system_id=self.system_id,
            note=self.note,
            open_driver=self.via.driver,
        )
        self.note(f"heard: system {self._heard.system_id}, {self._heard.profile.name}")
        self.via.check(scenario, self._heard)
        return fitted_to(scenario, self._heard)

    def numbered(self, vehicles: Sequence[Vehicle]) -> tuple[Vehicle, ...]:
        """Return the run's vehicle with the system id of the one that was heard."""
        assert self._heard is not None
        number = self._heard.system_id
        return tuple(replace(one, task=replace(one.task, system_id=number)) for one in vehicles)

    def check(self, plan: PlanResult, scenario: Scenario) -> None:
        """Check a plan before it goes up, and ask the vehicle for what the plan assumes.

        That the vehicle cannot arm yet is no error: the start waits for it.

        Raises
        ------
        PreflightError
            If there are errors, unless they are overruled.
        LinkError, NoVehicleError
            If the vehicle is not there any more.
        """
        assert self._heard is not None
        number = self._heard.system_id
        snapshot = ask_vehicle(self.url, wait_s=self.wait_s, system_id=number, note=self.note)
        circumstances = Circumstances(
            scenario.vehicle, scenario.weather, plan.farm, scenario.mission.margin_m, snapshot=snapshot
        )
        report = check_mission(plan.mission, circumstances).report
        counted = report.about(Concern.PLAN, Concern.PARAMETERS, Concern.STATE)
        refused = None if self.force else counted.refusal("nothing was sent")
        self.tell(report, refused)
        if refused is not None:
            raise refused

    def hosting(self, tlog: Path | None) -> Hosting:
        """Return where the flight takes place."""
        assert self._heard is not None
        return self.via.hosting(
            self.url, self._heard, tlog, agreed=self.agreed, force=self.force, note=self.note
        )
