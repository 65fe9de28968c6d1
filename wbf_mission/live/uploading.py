"""A mission on its way to a vehicle behind a link: the vehicle is asked, the mission checked and sent."""

from __future__ import annotations

from collections.abc import Callable

from mission.ground.link import DriverMaker, Note, ProgressCallback, TransferReport, own_driver, upload
from mission.model import Mission
from wbf_mission.preflight.finding import Concern, Report, ShowFindings, show_nobody
from wbf_mission.preflight.inquiry import VehicleSnapshot, ask_vehicle
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.progress import silent


def ignore_note(_text: str) -> None:
    """Tell nobody."""


def upload_checked(
    mission: Mission,
    link: str,
    around: Callable[[VehicleSnapshot], Circumstances],
    *,
    wait_s: float = 10.0,
    system_id: int | None = None,
    force: bool = False,
    show: ShowFindings = show_nobody,
    progress: ProgressCallback = silent,
    note: Note = ignore_note,
    open_driver: DriverMaker = own_driver,
) -> tuple[TransferReport, Report]:
    """Ask a vehicle, check a mission for it, send it, read it back; return the transfer and the findings.

    `around` tells for what the mission is checked, by what the vehicle told. The other parameters and errors
    are those of `mission.ground.link.upload`; PreflightError if the check finds errors and it is not forced.
    """
    snapshot = ask_vehicle(link, wait_s=wait_s, system_id=system_id, note=note)
    # How it stands there matters for a start only.
    found = check_mission(mission, around(snapshot)).report.about(Concern.PLAN, Concern.PARAMETERS)
    found.require_no_errors("nothing was sent", force=force, show=show)
    report = upload(
        mission,
        link,
        wait_s=wait_s,
        system_id=snapshot.system_id,
        progress=progress,
        note=note,
        force=force,
        parameters=snapshot.parameters,
        open_driver=open_driver,
    )
    return report, found
