"""Commands that change a flight as it is: fence, termination, heading, region of interest, orbit, home."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.model import RELATIVE_FRAMES, Command
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.motion.legs import KEEP
from sim_vehicle.pilot.notices import RefusedError

if TYPE_CHECKING:
    from sim_vehicle.mavlink.orders import CommandedVehicle, Order

__all__ = ["FLIGHT_COMMANDS"]

_TERMINATE = 0.5


def _altitude(vehicle: CommandedVehicle, order: Order, altitude_m: float) -> float:
    if not math.isfinite(altitude_m):
        return vehicle.pilot.state.position_m[2]
    return altitude_m - (0.0 if order.frame in RELATIVE_FRAMES else vehicle.state.home.altitude_m)


def fence_enable(vehicle: CommandedVehicle, order: Order) -> None:
    """DO_FENCE_ENABLE (ArduPilot): 0 off, 1 on, 2 all but the floor."""
    kind = order.number(1, -1)
    if kind not in (0, 1, 2):
        raise RefusedError(f"Fence refused: parameter 1 is {order.params[0]:g}", denied=True)
    vehicle.pilot.parameters.fence_enable = int(kind > 0)
    vehicle.pilot.apply_parameters()


def terminate(vehicle: CommandedVehicle, order: Order) -> None:
    """DO_FLIGHTTERMINATION: the motors stop."""
    if order.params[0] > _TERMINATE:
        vehicle.pilot.terminate("by command")


def yaw(vehicle: CommandedVehicle, order: Order) -> None:
    """CONDITION_YAW (ArduCopter): angle, rate, direction, whether it is relative; the vehicle flies on."""
    angle, rate, _, relative = order.params[:4]
    if not (0.0 <= angle <= 360.0 and relative in (0.0, 1.0)):
        raise RefusedError(f"Yaw refused: angle {angle:g}, parameter 4 {relative:g}", told="")
    direction = (order.number(3) > 0) - (order.number(3) < 0)
    vehicle.pilot.auto_yaw.order(math.radians(angle), math.radians(rate), direction, relative=relative == 1.0)


def region(vehicle: CommandedVehicle, order: Order) -> None:
    """DO_SET_ROI_LOCATION and DO_SET_ROI: point the nose at a position; without one, no more."""
    position = order.position if order.frame in (0, *RELATIVE_FRAMES) else None
    if position is None:
        vehicle.pilot.look_at(None)
    else:
        vehicle.pilot.look_at(*position)


def no_region(vehicle: CommandedVehicle, _order: Order) -> None:
    """DO_SET_ROI_NONE."""
    vehicle.pilot.look_at(None)


def orbit(vehicle: CommandedVehicle, order: Order) -> None:
    """DO_ORBIT (PX4): radius, speed, -, -, position; what is not given is 10 m, the cruise speed, here."""
    pilot = vehicle.pilot
    radius, speed = order.params[:2]
    position = order.position or pilot.frame.to_wgs84(*pilot.state.position_m[:2])
    pilot.orbit(
        *position,
        _altitude(vehicle, order, order.params[6]),
        radius_m=radius if math.isfinite(radius) and radius else 10.0,
        speed_m_s=speed if math.isfinite(speed) and speed > 0.0 else pilot.spec.cruise_speed_m_s,
        mode=vehicle.state.firmware.mavlink.modes.after_command,
    )
    if (number := vehicle.state.firmware.mavlink.modes.orbit) is not None:
        vehicle.state.name_mode(number)


def change_altitude(vehicle: CommandedVehicle, order: Order) -> None:
    """DO_CHANGE_ALTITUDE: altitude and its frame; where it is."""
    pilot = vehicle.pilot
    altitude, frame = order.params[0], order.number(2)
    if not math.isfinite(altitude) or frame not in (0, 3, 5, 6):
        msg = "Altitude refused: no altitude or frame"
        raise RefusedError(msg, denied=True)
    if frame not in RELATIVE_FRAMES:
        altitude -= vehicle.state.home.altitude_m
    x, y, _ = pilot.executor.motion.stopping_point()
    pilot.goto(
        *pilot.frame.to_wgs84(x, y),
        altitude,
        mode=vehicle.state.firmware.mavlink.modes.after_command,
        heading=KEEP,
    )


def land_start(vehicle: CommandedVehicle, _order: Order) -> None:
    """DO_LAND_START: go on with the mission where its landing begins."""
    seq = vehicle.pilot.executor.sequencer.landing_start()
    if seq is None:
        msg = "Land start refused: the mission has none"
        raise RefusedError(msg, told=vehicle.state.firmware.mavlink.refusals.landing)
    vehicle.pilot.set_current(seq)
    vehicle.pilot.set_mode(Mode.MISSION)


def go_around(vehicle: CommandedVehicle, order: Order) -> None:
    """DO_GO_AROUND (ArduPlane): break off the landing, climb to a height (0: the landing's own)."""
    height = order.params[0]
    vehicle.pilot.go_around(height if math.isfinite(height) and height > 0.0 else None)


def set_home(vehicle: CommandedVehicle, order: Order) -> None:
    """DO_SET_HOME: here (1) or at a position; the altitude stays that of the ground."""
    pilot = vehicle.pilot
    if order.params[0] == 1.0:
        position: tuple[float, float] | None = pilot.frame.to_wgs84(*pilot.state.position_m[:2])
    else:
        position = order.position
    if position is None:
        msg = "Home refused: no position"
        raise RefusedError(msg, denied=True)
    pilot.set_home(*position)
    vehicle.on_home_moved()


FLIGHT_COMMANDS = {
    int(m.MAV_CMD_DO_FENCE_ENABLE): fence_enable,
    int(m.MAV_CMD_DO_FLIGHTTERMINATION): terminate,
    int(Command.CONDITION_YAW): yaw,
    int(Command.DO_SET_ROI_LOCATION): region,
    int(Command.DO_SET_ROI): region,
    int(Command.DO_SET_ROI_NONE): no_region,
    int(m.MAV_CMD_DO_ORBIT): orbit,
    int(m.MAV_CMD_DO_CHANGE_ALTITUDE): change_altitude,
    int(Command.DO_LAND_START): land_start,
    int(m.MAV_CMD_DO_GO_AROUND): go_around,
    int(Command.DO_SET_HOME): set_home,
}
"""MAV_CMD to what is done; what it refuses is a RefusedError."""
