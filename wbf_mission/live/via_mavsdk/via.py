"""The way by MAVSDK: how a vehicle is found, what cannot be done, and where its flight takes place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from wbf_mission.live.discovery import LiveFlightError
from wbf_mission.live.via_mavsdk.driver import mavsdk_driver
from wbf_mission.live.via_mavsdk.hosting import MavsdkHosting
from wbf_mission.scenario import Scenario

__all__ = ["MavsdkVia"]


class MavsdkVia:
    """MAVSDK keeps the link, carries the plans and gives the orders; see `wbf_mission.live.via.Via`."""

    def driver(self, url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
        """Open a link; return what transfers plans over it."""
        return mavsdk_driver(url, on_event, on_text)

    def check_count(self, vehicles: int) -> None:
        """Refuse several vehicles.

        Raises
        ------
        LiveFlightError
            If there are several.
        """
        if vehicles > 1:
            msg = f"--via mavsdk flies one vehicle, not {vehicles}: leave out --via mavsdk, or fly one"
            raise LiveFlightError(msg)

    def check(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Refuse a policy for a vehicle that leaves its mission while that is changed.

        Raises
        ------
        LiveFlightError
            If that is so.
        """
        policy = scenario.mission.policy
        if policy is not None and vehicle.vehicle_type in (vehicle.profile.change_modes or {}):
            msg = (
                f"policy {policy} changes the mission in flight, which --via mavsdk does not do with "
                f"{vehicle.profile.name}: leave out --via mavsdk, or give a planner"
            )
            raise LiveFlightError(msg)

    def hosting(
        self,
        heard: Sequence[tuple[str, Vehicle]],
        tlog: Path | None,
        *,
        agreed: bool,
        force: bool,
        note: Callable[[str], None],
    ) -> MavsdkHosting:
        """Return where the flight takes place."""
        ((url, vehicle),) = heard
        return MavsdkHosting(url, vehicle, tlog, agreed=agreed, force=force, note=note)
