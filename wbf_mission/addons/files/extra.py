"""Adds files and logs to the simulated vehicle, as an optional part of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.mavlink.extras import VehicleExtra
from wbf_mission.addons.files.ftp import FtpServer, checksum
from wbf_mission.addons.files.logs import FlightLogs, LogMessage, LogTransfer
from wbf_mission.addons.files.vehicle_files import GENERAL_PATH, general_metadata, uri, vehicle_files

if TYPE_CHECKING:
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["Files"]


class Files(VehicleExtra):
    """Answers MAVLink FTP and LOG_REQUEST_*, and announces COMPONENT_METADATA."""

    capabilities = int(m.MAV_PROTOCOL_CAPABILITY_FTP)

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self._logs = FlightLogs(state.epoch_unix_s)
        transfer = LogTransfer(self._logs, state.pilot)
        ftp = FtpServer(vehicle_files(state.mavlink, parameters, self._logs, plans))
        self.timed = (ftp, transfer)
        self.handlers = {
            m.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: ftp.receive,
            **{message.id: transfer.receive for message in get_args(LogMessage)},
        }

    def log_frame(self, frame: bytes, message_id: int, now_s: float) -> None:
        """Append a frame to the log of the current flight."""
        self._logs.write(frame, message_id, now_s, armed=self.state.pilot.armed)

    def metadata(self) -> tuple[Message, ...]:
        """Return the COMPONENT_METADATA message; empty if the autopilot has no metadata."""
        details = self.state.mavlink.component_metadata
        if details is None:
            return ()
        crc = checksum(general_metadata(self.parameters, details))
        address = uri(GENERAL_PATH).encode()
        return (m.MAVLink_component_metadata_message(self.state.boot_ms, crc, address),)
