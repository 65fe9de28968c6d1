"""What a user of MAVSDK-Python below 4 writes: upload, fly, wait, take off, land.

Run with ``ADDRESS GRPC_PORT px4|ardupilot PLACES``, the places as JSON, home first.
"""

import asyncio
import json
import math
import os
import sys
import traceback

from mavsdk import System
from mavsdk.mission import MissionItem, MissionPlan
from mavsdk.mission_raw import MissionItem as RawItem

NAN = math.nan


async def until(stream, condition):
    async for value in stream:
        if condition(value):
            return value
    return None


async def watch(stream, seen):
    async for progress in stream:
        seen.append((progress.current, progress.total))


async def upload(drone, places):
    """With the mission plugin, which has no take-off item."""
    action, none = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
    items = [
        MissionItem(*place, 8.0, 5.0, True, NAN, NAN, action, NAN, NAN, NAN, NAN, NAN, none)
        for place in places[1:]
    ]
    await drone.mission.set_return_to_launch_after_mission(True)
    await drone.mission.upload_mission(MissionPlan(items))
    plan = await drone.mission.download_mission()
    assert len(plan.mission_items) == len(items), plan


async def upload_raw(drone, places):
    """With mission_raw, home first, as an ArduPilot wants it."""

    def item(seq, command, frame, latitude, longitude, altitude):
        x, y = round(latitude * 1e7), round(longitude * 1e7)
        return RawItem(seq, frame, command, int(seq == 0), 1, 0.0, 0.0, 0.0, 0.0, x, y, altitude, 0)

    items = [item(0, 16, 0, *places[0], 30.0), item(1, 22, 3, *places[0], 8.0)]
    items += [item(2 + number, 16, 3, *place, 8.0) for number, place in enumerate(places[1:])]
    items.append(item(len(items), 20, 3, 0.0, 0.0, 0.0))
    await drone.mission_raw.upload_mission(items)
    stored = await drone.mission_raw.download_mission()
    assert [i.x for i in stored[1:-1]] == [i.x for i in items[1:-1]], stored


async def main():
    address, grpc_port, autopilot, places = sys.argv[1:]
    ardupilot = autopilot == "ardupilot"
    drone = System(port=int(grpc_port))
    await drone.connect(system_address=address)
    await until(drone.core.connection_state(), lambda state: state.is_connected)
    telemetry = drone.telemetry
    await until(telemetry.health(), lambda h: h.is_global_position_ok and h.is_home_position_ok)
    plugin = drone.mission_raw if ardupilot else drone.mission
    await (upload_raw if ardupilot else upload)(drone, json.loads(places))
    seen = []
    watching = asyncio.ensure_future(watch(plugin.mission_progress(), seen))
    assert await drone.param.get_param_float("WPNAV_SPEED" if ardupilot else "MPC_XY_CRUISE") > 0.0
    await drone.action.arm()
    await plugin.start_mission()
    await until(telemetry.in_air(), lambda up: up)
    await until(telemetry.in_air(), lambda up: not up)
    await until(telemetry.armed(), lambda armed: not armed)
    watching.cancel()
    assert any(current == total > 0 for current, total in seen), seen
    await drone.action.set_takeoff_altitude(5.0)
    await drone.action.arm()
    await drone.action.takeoff()
    await until(telemetry.position(), lambda position: position.relative_altitude_m > 4.8)
    await drone.action.land()
    await until(telemetry.armed(), lambda armed: not armed)
    sys.stdout.write("landed\n")


if __name__ == "__main__":
    try:
        asyncio.run(main())
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)  # the threads of gRPC would keep a failed script alive
