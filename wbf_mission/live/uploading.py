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
    """Ask a vehicle, check a mission for it, send it, read it back; return the transfer and the findings.

    `around` makes the circumstances of the check from the vehicle's answers. The other parameters and errors
    are those of `mission.ground.link.upload`; PreflightError if the check finds errors and it is not forced.
    """
    snapshot = ask_vehicle(link, wait_s=wait_s, system_id=system_id, note=events.note)
    # How it stands there matters for a start only.
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
