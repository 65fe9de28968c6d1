"""Checked upload to a vehicle behind a link."""

from __future__ import annotations

from collections.abc import Callable

from mission.ground.link import DriverMaker, TransferReport, own_driver, upload
from mission.model import Mission
from wbf_mission.events import EventStream
from wbf_mission.preflight.finding import Concern, Report
from wbf_mission.preflight.inquiry import VehicleSnapshot, ask_vehicle
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances


def upload_checked(
    mission: Mission,
    link: str,
    around: Callable[[VehicleSnapshot], Circumstances],
    events: EventStream,
    *,
    wait_s: float = 10.0,
    system_id: int | None = None,
    force: bool = False,
    open_driver: DriverMaker = own_driver,
) -> tuple[TransferReport, Report]:
    """Query a vehicle, check a mission for it, upload and read back; return transfer and findings.

    `around` returns the circumstances of the check for the vehicle's answers. The other parameters and errors
    are those of `mission.ground.link.upload`. Raises PreflightError if the check finds errors, unless
    `force`.
    """
    snapshot = ask_vehicle(link, wait_s=wait_s, system_id=system_id, note=events.note)
    # The vehicle's present state matters only for a start.
    found = check_mission(mission, around(snapshot)).report.about(Concern.PLAN, Concern.PARAMETERS)
    found.require_no_errors("nothing was sent", events, force=force)
    report = upload(
        mission,
        link,
        wait_s=wait_s,
        system_id=snapshot.system_id,
        progress=events.progress,
        note=events.note,
        force=force,
        parameters=snapshot.parameters,
        open_driver=open_driver,
    )
    return report, found
