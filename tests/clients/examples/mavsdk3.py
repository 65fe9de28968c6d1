"""The examples of MAVSDK-Python 3 for a copter, written after them: the same calls in the same order.

Run with ``NAME [ADDRESS [GRPC_PORT]]``. They wait by `clock`; streams that the examples read until they are
stopped end after some values.
"""

import asyncio
import base64
import json
import math
import os
import sys
import traceback
from pathlib import Path

from clock import wait_async as wait
from mavsdk import System, mavlink_direct
from mavsdk.action import OrbitYawBehavior
from mavsdk.camera import Mode
from mavsdk.follow_me import Config, TargetLocation
from mavsdk.geofence import Circle, FenceType, GeofenceData, Point, Polygon
from mavsdk.mission import MissionItem, MissionPlan
from mavsdk.mission_raw import MissionItem as RawItem
from mavsdk.offboard import Attitude, PositionNedYaw, VelocityBodyYawspeed, VelocityNedYaw
from mavsdk.rtk import RtcmData
from mavsdk.server_utility import StatusTextType
from mavsdk.telemetry import LandedState
from mavsdk.tune import SongElement, TuneDescription

ADDRESS = sys.argv[2] if len(sys.argv) > 2 else "udpin://0.0.0.0:14540"
GRPC_PORT = int(sys.argv[3]) if len(sys.argv) > 3 else 50051
NAN = math.nan
PLACES = ((47.39803986, 8.54557254), (47.39803622, 8.54501464), (47.39782562, 8.54500928))


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


async def until(stream, condition):
    async for value in stream:
        if condition(value):
            return value
    return None


async def first(stream):
    return await until(stream, lambda value: True)


async def values(stream, count):
    """The first values of a stream that an example prints until it is stopped."""
    async for value in stream:
        say(value)
        count -= 1
        if count == 0:
            return


async def said(stream, words_of):
    async for value in stream:
        say(words_of(value))


async def connected(**options):
    drone = System(port=GRPC_PORT, **options)
    await drone.connect(system_address=ADDRESS)
    await until(drone.core.connection_state(), lambda state: state.is_connected)
    return drone


async def healthy():
    drone = await connected()
    await until(drone.telemetry.health(), lambda h: h.is_global_position_ok and h.is_home_position_ok)
    return drone


async def all_params():
    drone = System(port=GRPC_PORT)
    await drone.connect(system_address=ADDRESS)
    params = await drone.param.get_all_params()
    for param in (*params.int_params, *params.float_params):
        say(f"{param.name}: {param.value}")


async def calibration():
    drone = await connected()
    await values(drone.calibration.calibrate_gyro(), 0)
    say("gyro calibrated")


async def camera():
    drone = await connected()
    number = (await until(drone.camera.camera_list(), lambda found: found.cameras)).cameras[0].component_id
    await drone.camera.set_mode(number, Mode.PHOTO)
    await wait(2)
    await drone.camera.take_photo(number)


async def do_orbit():
    drone = await healthy()
    position = await first(drone.telemetry.position())
    height = position.absolute_altitude_m + 10
    await drone.action.arm()
    await drone.action.takeoff()
    await wait(10)
    await drone.action.do_orbit(
        radius_m=10,
        velocity_ms=2,
        yaw_behavior=OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER,
        latitude_deg=47.398036222362471,
        longitude_deg=8.5450146439425509,
        absolute_altitude_m=height,
    )
    await wait(60)
    await drone.action.return_to_launch()


async def firmware_version():
    drone = await connected()
    say(await drone.info.get_version())


async def follow_me_example():
    drone = await healthy()
    await drone.action.arm()
    await drone.follow_me.set_config(Config(8.0, 2.0, 0.02, Config.FollowAltitudeMode.TARGET_GPS, 10, 0))
    await drone.action.takeoff()
    await wait(8)
    await drone.follow_me.start()
    await wait(8)
    for latitude, longitude in PLACES:
        await drone.follow_me.set_target_location(TargetLocation(latitude, longitude, 480.0, 0, 0, 0))
        await wait(2)
    await drone.follow_me.stop()
    await wait(5)
    await drone.action.land()


async def ftp_list_dir():
    drone = await connected()
    say(await drone.ftp.list_directory("/"))


async def ftp_download_file():
    drone = await connected()
    async for update in drone.ftp.download("/etc/extras/component_general.json.xz", ".", use_burst=False):
        say(f"got {update.bytes_transferred} of {update.total_bytes}")


async def geofence():
    drone = await connected()
    home = await first(drone.telemetry.home())
    await wait(1)
    corners = [
        Point(home.latitude_deg + north * 1e-4, home.longitude_deg + east * 1e-4)
        for north, east in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    polygon = Polygon(corners, FenceType.INCLUSION)
    circle = Circle(Point(0, 0), 0, FenceType.INCLUSION)
    await drone.geofence.upload_geofence(GeofenceData([polygon], [circle]))


async def goto():
    drone = await healthy()
    altitude = (await first(drone.telemetry.home())).absolute_altitude_m
    await drone.action.arm()
    await drone.action.takeoff()
    await wait(1)
    await drone.action.goto_location(47.397606, 8.543060, altitude + 20.0, 0)
    await wait(60)


async def highres_imu():
    drone = await connected()
    await drone.telemetry.set_rate_imu(200.0)
    await values(drone.telemetry.imu(), 50)


async def logfile_download():
    drone = await connected()
    for entry in await drone.log_files.get_entries():
        say(f"log {entry.id} {entry.date} {entry.size_bytes}")
        name = f"./log-{entry.date.replace(':', '-')}.ulog"
        async for _ in drone.log_files.download_log_file(entry, name):
            pass
        say("downloaded", Path(name).stat().st_size)


async def manual_control():
    drone = await healthy()
    await drone.manual_control.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
    await drone.action.arm()
    await drone.action.takeoff()
    await wait(5)
    await drone.manual_control.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
    await drone.manual_control.start_position_control()
    inputs = ((0, 0, 0.5, 0), (0, 1, 0.5, 0), (1, 0, 0.5, 0), (0, 0, 0.5, 1), (0, 0, 1, 0))
    for roll, pitch, throttle, yaw in inputs:  # the example takes them by chance, without an end
        for _ in range(20):
            await drone.manual_control.set_manual_control_input(
                float(pitch), float(roll), float(throttle), float(yaw)
            )
            await wait(0.1)


async def mavlink_direct_receive():
    drone = await connected()
    async for message in drone.mavlink_direct.message("ATTITUDE"):
        say(message.message_name, message.system_id, json.dumps(json.loads(message.fields_json)))
        return


AIRSPEED = """<mavlink><messages><message id="295" name="AIRSPEED"><description>Airspeed.</description>
<field type="uint8_t" name="id" instance="true">Sensor.</field>
<field type="float" name="airspeed" units="m/s">Calibrated.</field>
<field type="int16_t" name="temperature" units="cdegC">Temperature.</field>
<field type="float" name="raw_press" units="hPa">Pressure.</field>
<field type="uint8_t" name="flags" enum="AIRSPEED_SENSOR_FLAGS">Flags.</field>
</message></messages></mavlink>"""


async def mavlink_direct_send():
    drone = await connected()
    await drone.mavlink_direct.load_custom_xml(AIRSPEED)
    for number in range(20):
        fields = {"id": 0, "airspeed": float(number), "temperature": 2000, "raw_press": 1010, "flags": 0}
        message = mavlink_direct.MavlinkMessage("AIRSPEED", 245, 25, 0, 0, json.dumps(fields))
        await drone.mavlink_direct.send_message(message)
        await wait(0.1)


def mission_item(latitude, longitude, height, speed):
    action, none = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
    return MissionItem(
        latitude, longitude, height, speed, True, NAN, NAN, action, NAN, NAN, NAN, NAN, NAN, none
    )


async def landed_again(drone):
    await until(drone.telemetry.in_air(), lambda up: up)
    await until(drone.telemetry.in_air(), lambda up: not up)


async def mission():
    drone = await connected()
    steps = drone.mission.mission_progress()
    watching = asyncio.ensure_future(said(steps, lambda step: f"progress {step.current}/{step.total}"))
    landing = asyncio.ensure_future(landed_again(drone))
    plan = MissionPlan([mission_item(*place, 25, 10) for place in PLACES])
    await drone.mission.set_return_to_launch_after_mission(True)
    await drone.mission.upload_mission(plan)
    await until(drone.telemetry.health(), lambda h: h.is_global_position_ok and h.is_home_position_ok)
    await drone.action.arm()
    await drone.mission.start_mission()
    await landing
    watching.cancel()


def plan_file():
    """What QGroundControl saves: a take-off, three waypoints, a return, and a rally point."""

    def item(number, command, frame, params):
        return {
            "type": "SimpleItem", "autoContinue": True, "command": command, "doJumpId": number,
            "frame": frame, "params": params,
        }  # fmt: skip

    places = [item(1, 22, 3, [0, 0, 0, None, *PLACES[0], 15])]
    places += [item(2 + n, 16, 3, [0, 0, 0, None, *place, 15]) for n, place in enumerate(PLACES)]
    places.append(item(5, 20, 2, [0, 0, 0, 0, 0, 0, 0]))
    return {
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [[47.3978, 8.5451, 20]], "version": 2},
        "mission": {
            "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5,
            "globalPlanAltitudeMode": 1, "plannedHomePosition": [47.397742, 8.545594, 488], "items": places,
        },
    }  # fmt: skip


async def mission_import():
    drone = await connected()
    Path("example-mission.plan").write_text(json.dumps(plan_file()))
    read = await drone.mission_raw.import_qgroundcontrol_mission("example-mission.plan")
    say(f"{len(read.mission_items)} items and {len(read.rally_items)} rally points")
    await drone.mission_raw.upload_mission(read.mission_items)
    await drone.mission_raw.upload_rally_points(read.rally_items)


async def mission_raw():
    drone = await connected()
    north = int(47.40271757 * 10**7)
    easts = (int(degrees * 10**7) for degrees in (8.54285027, 8.54361892))
    items = [
        RawItem(seq, 3, 16, int(seq == 0), 1, 0, 10, 0, NAN, north, east, 30.0, 0)
        for seq, east in enumerate(easts)
    ]
    await drone.mission_raw.upload_mission(items)


async def offboard(first_setpoint, steps, *, land=False):
    drone = await healthy()
    await drone.action.arm()
    await first_setpoint(drone.offboard)
    await drone.offboard.start()
    for setpoint, seconds in steps:
        await setpoint(drone.offboard)
        await wait(seconds)
    if land is None:  # position_velocity lands first
        await drone.action.land()
    await drone.offboard.stop()
    if land:
        await drone.action.land()


async def offboard_attitude():
    def at(*target):
        return lambda control: control.set_attitude(Attitude(*target))

    steps = ((at(0.0, 0.0, 0.0, 0.7), 2), (at(30.0, 0.0, 0.0, 0.6), 2))
    steps += ((at(-30.0, 0.0, 0.0, 0.6), 2), (at(0.0, 0.0, 0.0, 0.6), 2))
    await offboard(at(0.0, 0.0, 0.0, 0.0), steps, land=True)


async def offboard_position_ned():
    def at(*target):
        return lambda control: control.set_position_ned(PositionNedYaw(*target))

    steps = ((at(0.0, 0.0, -5.0, 0.0), 10), (at(5.0, 0.0, -5.0, 90.0), 10))
    steps += ((at(5.0, 10.0, -5.0, 90.0), 15), (at(0.0, 10.0, 0.0, 180.0), 10))
    await offboard(at(0.0, 0.0, 0.0, 0.0), steps)


async def offboard_position_velocity_ned():
    def at(place, velocity):
        return lambda control: control.set_position_velocity_ned(
            PositionNedYaw(*place), VelocityNedYaw(*velocity)
        )

    def start(control):
        return control.set_position_ned(PositionNedYaw(0.0, 0.0, 0.0, 0.0))

    steps = ((at((0.0, 0.0, -10.0, 0.0), (0.0, 0.0, -1.0, 0.0)), 10),)
    steps += ((at((50.0, 0.0, -10.0, 0.0), (1.0, 0.0, 0.0, 0.0)), 20),)
    await offboard(start, steps, land=None)


async def offboard_velocity_body():
    def at(*target):
        return lambda control: control.set_velocity_body(VelocityBodyYawspeed(*target))

    still = at(0.0, 0.0, 0.0, 0.0)
    steps = ((at(0.0, 0.0, -1.0, 60.0), 5), (at(0.0, 0.0, 0.0, -60.0), 5), (still, 2))
    steps += ((at(5.0, 0.0, 0.0, 30.0), 15), (still, 5), (at(0.0, -5.0, 0.0, 30.0), 15), (still, 8))
    await offboard(still, steps)


async def offboard_velocity_ned():
    def at(*target):
        return lambda control: control.set_velocity_ned(VelocityNedYaw(*target))

    steps = ((at(0.0, 0.0, -2.0, 0.0), 4), (at(2.0, 0.0, 0.0, 90.0), 4), (at(-2.0, 0.0, 0.0, 270.0), 4))
    steps += ((at(0.0, -2.0, 0.0, 90.0), 4), (at(0.0, 2.0, 0.0, 90.0), 4))
    steps += ((at(0.0, 0.0, 0.0, 180.0), 2), (at(0.0, 0.0, 1.0, 0.0), 4))
    await offboard(at(0.0, 0.0, 0.0, 0.0), steps)


async def offboard_from_csv():
    """Climb 10 m, fly a circle of 5 m by positions and velocities at 10 Hz, return, land."""
    drone = await healthy()
    await drone.action.arm()
    await drone.offboard.set_position_ned(PositionNedYaw(0.0, 0.0, 0.0, 0.0))
    await drone.offboard.start()
    rows = [((0.0, 0.0, -0.1 * n), (0.0, 0.0, -1.0)) for n in range(100)]
    for n in range(250):
        angle = math.tau * n / 250
        sine, cosine = math.sin(angle), math.cos(angle)
        rate = math.tau / 25.0 * 5.0
        rows.append(((5.0 * sine, 5.0 - 5.0 * cosine, -10.0), (rate * cosine, rate * sine, 0.0)))
    for place, velocity in rows:
        await drone.offboard.set_position_velocity_ned(
            PositionNedYaw(*place, 0.0), VelocityNedYaw(*velocity, 0.0)
        )
        await wait(0.1)
    await drone.action.land()
    await until(drone.telemetry.landed_state(), lambda state: state == LandedState.ON_GROUND)
    try:
        await drone.offboard.stop()
    except Exception as error:
        say(f"stop: {error}")
    await drone.action.disarm()


async def rtcm():
    drone = System(port=GRPC_PORT)
    await drone.connect(system_address=ADDRESS)
    await drone.rtk.send_rtcm_data(RtcmData(base64.b64encode(b"\xd3\x00\x04test\x01\x02\x03").decode()))


async def send_status_message():
    drone = await connected(sysid=1)
    await drone.server_utility.send_status_text(StatusTextType.INFO, "Hello world!")


async def takeoff_and_land():
    drone = await healthy()
    watching = asyncio.ensure_future(said(drone.telemetry.status_text(), lambda text: f"status {text.text}"))
    await drone.action.arm()
    await drone.action.takeoff()
    await wait(10)
    await drone.action.land()
    watching.cancel()


async def telemetry():
    drone = System(port=GRPC_PORT)
    await drone.connect(system_address=ADDRESS)
    streams = ("battery", "gps_info", "in_air", "position")
    await asyncio.gather(*(values(getattr(drone.telemetry, name)(), 1) for name in streams))


async def telemetry_flight_mode():
    drone = await connected()
    await values(drone.telemetry.flight_mode(), 1)


async def telemetry_is_armed_is_in_air():
    drone = System(port=GRPC_PORT)
    await drone.connect(system_address=ADDRESS)
    await asyncio.gather(values(drone.telemetry.armed(), 1), values(drone.telemetry.in_air(), 1))


async def telemetry_status_text():
    drone = await connected()
    listening = asyncio.ensure_future(values(drone.telemetry.status_text(), 1))
    await asyncio.sleep(1.0)
    await drone.action.arm()  # a user does so elsewhere
    await listening


async def telemetry_takeoff_and_land():
    drone = await connected()
    landing = asyncio.ensure_future(landed_again(drone))
    await until(drone.telemetry.health(), lambda h: h.is_global_position_ok and h.is_home_position_ok)
    await drone.action.arm()
    await drone.action.set_takeoff_altitude(10.0)
    await drone.action.takeoff()
    await wait(10)
    await drone.action.land()
    await landing


async def tune():
    drone = await connected()
    notes = [SongElement.DURATION_4, SongElement.NOTE_G, SongElement.NOTE_A, SongElement.NOTE_B]
    notes += [SongElement.FLAT, SongElement.OCTAVE_UP, SongElement.DURATION_1, SongElement.NOTE_E]
    await drone.tune.play_tune(TuneDescription(notes, 200))


async def upload_params():
    drone = System(port=GRPC_PORT)
    await drone.connect(system_address=ADDRESS)
    params = await drone.param.get_all_params()
    integers = {param.name for param in params.int_params}
    floats = {param.name for param in params.float_params}
    await until(drone.telemetry.in_air(), lambda up: not up)
    rows = ("1\t1\tCOM_DISARM_PRFLT\t20\t9", "1\t1\tRTL_RETURN_ALT\t35\t9", "1\t1\tMPC_XY_CRUISE\t6\t9")
    rows += ("1\t1\tNAV_RCL_ACT\t1\t6",)
    for row in rows:
        _, _, name, value, _ = row.split("\t")
        if name in integers:
            await drone.param.set_param_int(name, int(value))
        elif name in floats:
            await drone.param.set_param_float(name, float(value))


if __name__ == "__main__":
    try:
        asyncio.run(globals()[sys.argv[1]]())
        say("done")
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)  # the threads of gRPC would keep a failed script alive
