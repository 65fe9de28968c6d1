"""How an order is given to a vehicle as it stands or flies there, and what shows that it is carried out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from mission.autopilots.registry import profile_for
from mission.ground.modes import Maneuver, maneuver_command, maneuver_modes, mode_named, told_name
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from wbf_mission.live.errors import MotorsStandError, VehicleRefusedError
from wbf_mission.live.wishes import Wish

__all__ = ["OFF_GROUND_M", "Step", "is_ready", "step_of"]

OFF_GROUND_M = 0.5
"""A vehicle that is so high above home has left the ground."""


@dataclass(frozen=True, slots=True)
class Step:
    """What is sent to a vehicle, and what shows that it is carried out.

    Parameters
    ----------
    shown : callable
        Tells by what was heard of the vehicle whether it is carried out.
    command : int or None
        MAV_CMD; None where only `message` is sent.
    params : tuple of float
        Its first parameters.
    message : Message or None
        What is sent to a vehicle that does not know the command. Nothing answers it.
    """

    shown: Callable[[VehicleMonitor], bool]
    command: int | None = None
    params: tuple[float, ...] = ()
    message: Message | None = None


def is_ready(wish: Wish, heard: VehicleMonitor) -> bool:
    """Tell whether all is heard of a vehicle that `step_of` asks for."""
    if wish.order == "takeoff":
        # Who stands with motors that are off is refused anyway.
        return not heard.state.armed or (heard.position_heard_s > -math.inf and heard.flies is not None)
    return wish.order != "set-item" or heard.item_heard_s > -math.inf


def step_of(wish: Wish, vehicle: tuple[int, int], heard: VehicleMonitor) -> Step:
    """Return how a vehicle is given an order.

    Parameters
    ----------
    wish : Wish
    vehicle : tuple of int
        System and component id.
    heard : VehicleMonitor
        What it told of itself.

    Raises
    ------
    VehicleRefusedError
        If the vehicle, as it is now, could not carry it out.
    MotorsStandError
        If it would start its motors, and the wish does not say so.
    ModeError
        If it has no mode of that name.
    """
    kind = (heard.autopilot, heard.vehicle_type)
    if wish.order in ("arm", "disarm"):
        wanted = wish.order == "arm"
        return Step(
            lambda one: one.state.armed == wanted, int(m.MAV_CMD_COMPONENT_ARM_DISARM), (float(wanted),)
        )
    if wish.order == "takeoff":
        return _takeoff(wish, vehicle[0], heard)
    if wish.order == "mission":
        profile = profile_for(heard.autopilot)
        if profile.start_arms and not heard.state.armed and not wish.arms:
            msg = (
                f"system {vehicle[0]}: {wish}: the motors stand still; {profile.name} starts them and takes"
                " off at this order: give --arm, too, if it may"
            )
            raise MotorsStandError(msg)
        return Step(lambda one: one.in_mission, int(m.MAV_CMD_MISSION_START))
    if wish.order == "set-item":
        return _set_item(wish, vehicle, heard)
    if wish.order == "mode":
        numbers, name = mode_named(*kind, wish.value), told_name(kind[0], wish.value)
        params = (numbers.base, numbers.main, numbers.sub)
        return Step(lambda one: one.mode == name, int(m.MAV_CMD_DO_SET_MODE), params)
    maneuver = Maneuver(wish.order)
    modes = maneuver_modes(maneuver, *kind)
    return Step(
        lambda one: one.mode in modes if modes else not one.in_mission, *maneuver_command(maneuver, *kind)
    )


def _takeoff(wish: Wish, system_id: int, heard: VehicleMonitor) -> Step:
    state = heard.state
    if not state.armed:
        msg = f"system {system_id}: {wish}: the motors stand still; arm first (order arm)"
        raise VehicleRefusedError(msg)
    if heard.flies if heard.flies is not None else state.height_m > OFF_GROUND_M:
        msg = (
            f"system {system_id}: {wish}: it flies already, {state.height_m:.1f} m above home in mode"
            f" {heard.mode}; give the orders hold, return, land, mission or mode"
        )
        raise VehicleRefusedError(msg)
    profile = profile_for(heard.autopilot)
    altitude_m = wish.height_m + (heard.home_altitude_m if profile.takeoff_above_sea else 0.0)
    default = math.nan if profile.nan_parameters is None else 0.0
    params = (0.0, 0.0, 0.0, default, default, default, altitude_m)
    start_m = state.height_m
    return Step(lambda one: one.state.height_m > start_m + OFF_GROUND_M, int(m.MAV_CMD_NAV_TAKEOFF), params)


def _set_item(wish: Wish, vehicle: tuple[int, int], heard: VehicleMonitor) -> Step:
    count, item = heard.state.total, wish.item
    if count is not None and item >= count:
        there = f"its mission has {count} items; give 1 to {count}"
        msg = f"system {vehicle[0]}: {wish}: {there if count else 'it holds no mission; upload one'}"
        raise VehicleRefusedError(msg)
    profile = profile_for(heard.autopilot)
    seq = item + (1 if profile.home_at_zero else 0)
    by_message = m.MAVLink_mission_set_current_message(*vehicle, seq)
    command = int(m.MAV_CMD_DO_SET_MISSION_CURRENT) if profile.item_command else None
    return Step(lambda one: one.state.item == item, command, (float(seq),), by_message)
