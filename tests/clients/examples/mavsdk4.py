"""The examples of MAVSDK 4 for a copter, written after them: the same calls in the same order.

Run with ``NAME [ADDRESS]``; ``asyncio_`` names are those of its asyncio API. They wait by `clock`.
"""

import asyncio
import json
import sys
import time

from clock import wait, wait_async
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio import Mavsdk as MavsdkAsync
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import Action
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import LandedState, Telemetry

ADDRESS = sys.argv[2] if len(sys.argv) > 2 else "udpin://0.0.0.0:14540"
_KEPT = []  # MAVSDK ends with its object


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def configured(kind=ComponentType.GROUND_STATION):
    return Configuration.create_with_component_type(kind)


def found(**options):
    mavsdk = Mavsdk(configured(**options))
    _KEPT.append(mavsdk)
    mavsdk.add_any_connection(ADDRESS)
    while True:
        for system in mavsdk.get_systems():
            if system.has_autopilot() and system.is_connected():
                return system
        time.sleep(0.1)


async def found_async():
    mavsdk = MavsdkAsync(configured())
    _KEPT.append(mavsdk)
    await mavsdk.add_any_connection(ADDRESS)
    async for _ in mavsdk.on_new_system():
        for system in await mavsdk.get_systems():
            if await system.has_autopilot() and await system.is_connected():
                return system
    return None


def is_healthy(health):
    names = ("gyrometer_calibration", "accelerometer_calibration", "magnetometer_calibration")
    names += ("local_position", "global_position", "home_position")
    return all(getattr(health, f"is_{name}_ok") for name in names)


def plan():
    action = MissionItem.CameraAction
    rows = (
        (47.398170327, 8.545649022, 5.0, False, 20.0, 60.0, action.NONE),
        (47.398241338, 8.545536011, 2.0, True, 0.0, -60.0, action.TAKE_PHOTO),
        (47.398139364, 8.545384616, 5.0, True, -45.0, 0.0, action.START_VIDEO),
        (47.398058617, 8.545461804, 2.0, False, -90.0, 30.0, action.STOP_VIDEO),
        (47.398100366, 8.545696914, 5.0, False, -45.0, -30.0, action.START_PHOTO_INTERVAL),
        (47.398001890, 8.545557618, 5.0, False, 0.0, 0.0, action.STOP_PHOTO_INTERVAL),
    )
    items = []
    for row in rows:
        item = MissionItem()
        item.latitude_deg, item.longitude_deg, item.speed_m_s, item.is_fly_through = row[:4]
        item.gimbal_pitch_deg, item.gimbal_yaw_deg, item.camera_action = row[4:]
        item.relative_altitude_m, item.loiter_time_s, item.yaw_deg = 10.0, 0.0, 0.0
        item.acceptance_radius_m, item.camera_photo_interval_s, item.camera_photo_distance_m = 1.0, 1.0, 0.0
        item.vehicle_action = MissionItem.VehicleAction.NONE
        items.append(item)
    return MissionPlan(items)


def mission():
    drone = found()
    action, mission, telemetry = Action(drone), Mission(drone), Telemetry(drone)
    while not is_healthy(telemetry.health()):
        time.sleep(0.1)
    mission.upload_mission(plan())
    action.arm()
    reached = []

    def progress(step, user_data=None):
        say(f"progress {step.current}/{step.total}")
        reached.append(step.current)

    mission.subscribe_mission_progress(progress)
    mission.start_mission()
    while not reached or reached[-1] < 2:
        time.sleep(0.1)
    mission.pause_mission()
    say("paused")
    wait(5)
    mission.start_mission()
    while not mission.is_mission_finished():
        time.sleep(0.1)
    action.return_to_launch()
    wait(2)
    while telemetry.armed():
        time.sleep(0.1)


def params():
    param = Param(found())
    every = param.get_all_params()
    for one in (*every.int_params, *every.float_params):
        say(f"{one.name}: {one.value}")
    try:
        param.get_param_float("NAV_RCL_ACT")
    except Exception as error:
        say("as float", error)
    say("as integer", param.get_param_int("NAV_RCL_ACT"))
    try:
        param.set_param_int("MPC_XY_CRUISE", 7)
    except Exception as error:
        say("as integer", error)
        param.set_param_float("MPC_XY_CRUISE", 7.0)


def takeoff_and_land():
    action = Action(found())
    say("takeoff altitude", action.get_takeoff_altitude())
    say("return altitude", action.get_return_to_launch_altitude())
    action.arm()
    action.takeoff()
    wait(4)  # the example's 2 s end while the vehicle is on the ground, where PX4 disarms it
    action.land()


def telemetry():
    drone = found()
    action, telemetry = Action(drone), Telemetry(drone)
    positions = []
    telemetry.subscribe_position(lambda position, user_data=None: positions.append(position))
    action.arm()
    action.takeoff()
    wait(10)
    say("altitude", telemetry.position().relative_altitude_m, len(positions) > 3)
    action.land()
    states = []
    telemetry.subscribe_landed_state(lambda state, user_data=None: states.append(state))
    while LandedState.ON_GROUND not in states:
        time.sleep(0.1)


GAS_SENSOR = """<mavlink><messages><message id="44000" name="GAS_SENSOR"><description>Gas.</description>
<field type="uint64_t" name="time_usec" units="us">Time.</field>
<field type="uint8_t" name="id" instance="true">Sensor.</field>
<field type="float" name="co2" units="ppm">Carbon dioxide.</field>
</message></messages></mavlink>"""


def mavlink_direct():
    configuration = configured(ComponentType.COMPANION_COMPUTER)
    ids = configuration.system_id, configuration.component_id
    direct = MavlinkDirect(found(kind=ComponentType.COMPANION_COMPUTER))
    seen = []
    direct.subscribe_message("GLOBAL_POSITION_INT", lambda message, user_data=None: seen.append(message))
    direct.load_custom_xml(GAS_SENSOR)
    for counter in range(20):
        fields = json.dumps({"time_usec": counter, "id": 0, "co2": 420.0 + 5.0 * counter})
        direct.send_message(MavlinkMessage("GAS_SENSOR", *ids, 0, 0, fields))
        wait(0.2)
    say("latitude", json.loads(seen[-1].fields_json)["lat"])


async def asyncio_mission():
    drone = await found_async()
    action, mission, telemetry = ActionAsync(drone), MissionAsync(drone), TelemetryAsync(drone)
    while not is_healthy(await telemetry.health()):
        await asyncio.sleep(0.1)
    await mission.upload_mission(plan())
    await action.arm()
    want_to_pause = asyncio.Event()

    async def watch():
        async for step in mission.subscribe_mission_progress():
            say(f"progress {step.current}/{step.total}")
            if step.current >= 2:
                want_to_pause.set()

    watching = asyncio.create_task(watch())
    await mission.start_mission()
    await want_to_pause.wait()
    await mission.pause_mission()
    say("paused")
    await wait_async(5)
    await mission.start_mission()
    while not await mission.is_mission_finished():
        await asyncio.sleep(0.1)
    watching.cancel()
    await action.return_to_launch()
    await wait_async(2)
    while await telemetry.armed():
        await asyncio.sleep(0.1)


async def asyncio_params():
    param = ParamAsync(await found_async())
    every = await param.get_all_params()
    for one in (*every.int_params, *every.float_params):
        say(f"{one.name}: {one.value}")
    say("as integer", await param.get_param_int("NAV_RCL_ACT"))
    await param.set_param_float("MPC_XY_CRUISE", 7.0)


async def asyncio_takeoff_and_land():
    action = ActionAsync(await found_async())
    say("takeoff altitude", await action.get_takeoff_altitude())
    say("return altitude", await action.get_return_to_launch_altitude())
    await action.arm()
    await action.takeoff()
    await wait_async(4)
    await action.land()


async def asyncio_telemetry():
    drone = await found_async()
    action, telemetry = ActionAsync(drone), TelemetryAsync(drone)
    positions = []

    async def watch():
        async for position in telemetry.subscribe_position():
            positions.append(position)  # noqa: PERF401

    watching = asyncio.create_task(watch())
    await action.arm()
    await action.takeoff()
    await wait_async(10)
    say("altitude", (await telemetry.position()).relative_altitude_m, len(positions) > 3)
    await action.land()
    async for state in telemetry.subscribe_landed_state():
        if state == LandedState.ON_GROUND:
            break
    watching.cancel()


if __name__ == "__main__":
    example = globals()[sys.argv[1]]
    if asyncio.iscoroutinefunction(example):
        asyncio.run(example())
    else:
        example()
    say("done")
