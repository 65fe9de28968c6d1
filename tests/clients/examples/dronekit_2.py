"""The examples of DroneKit 2.9.2 that a copter can fly, written after them: the same calls in the same order.

Run with ``NAME [ADDRESS]``. They wait by `clock`. DroneKit was written for Python before 3.10,
which took `collections.MutableMapping` away.
"""

import collections
import collections.abc
import math
import sys
import time
from pathlib import Path

collections.MutableMapping = collections.abc.MutableMapping
collections.Callable = collections.abc.Callable

from clock import now, wait  # noqa: E402
from dronekit import Command, LocationGlobalRelative, Vehicle, VehicleMode, connect  # noqa: E402
from pymavlink import mavutil  # noqa: E402

ADDRESS = sys.argv[2] if len(sys.argv) > 2 else "tcp:127.0.0.1:5760"
RELATIVE = mavutil.mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
EARTH_M = 6378137.0


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def until(condition, limit_s=200.0):
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def opened(**options):
    return connect(ADDRESS, wait_ready=True, **options)


def beside(place, north_m, east_m):
    """A place so many metres north and east of another, at its altitude."""
    latitude = place.lat + math.degrees(north_m / EARTH_M)
    longitude = place.lon + math.degrees(east_m / (EARTH_M * math.cos(math.radians(place.lat))))
    return type(place)(latitude, longitude, place.alt)


def metres_between(one, other):
    return math.hypot(other.lat - one.lat, other.lon - one.lon) * 1.113195e5


def arm_and_takeoff(vehicle, altitude_m):
    until(lambda: vehicle.is_armable)
    vehicle.mode = VehicleMode("GUIDED")
    vehicle.armed = True
    until(lambda: vehicle.armed)
    vehicle.simple_takeoff(altitude_m)
    until(lambda: vehicle.location.global_relative_frame.alt >= 0.95 * altitude_m)


def channel_overrides():
    vehicle = opened()
    say("channels", [vehicle.channels[str(number)] for number in range(1, 9)], len(vehicle.channels))
    vehicle.channels.overrides["2"] = 200
    vehicle.channels.overrides = {"3": 300}
    numbers = {"1": 110, "2": 210, "3": 310, "4": 4100, "5": 510, "6": 610, "7": 710, "8": 810}
    vehicle.channels.overrides = numbers
    vehicle.channels.overrides["2"] = None
    del vehicle.channels.overrides["3"]
    vehicle.channels.overrides = {"5": None, "6": None, "3": 500}
    say("overrides", vehicle.channels.overrides)
    vehicle.channels.overrides = {}
    say("overrides", vehicle.channels.overrides)
    vehicle.close()


class RawImu(Vehicle):
    """A vehicle with an attribute of RAW_IMU."""

    def __init__(self, *args):
        super().__init__(*args)
        self.raw_imu = None

        @self.on_message("RAW_IMU")
        def listen(vehicle, name, message):
            vehicle.raw_imu = (message.time_usec, message.xacc, message.yacc, message.zacc)
            vehicle.notify_attribute_listeners("raw_imu", vehicle.raw_imu)


def create_attribute():
    vehicle = opened(vehicle_class=RawImu)
    vehicle.add_attribute_listener("raw_imu", lambda vehicle, name, value: say(name, value))
    wait(5)
    vehicle.close()


def flight_replay():
    """The places of a log, here a zigzag, flown as a mission until its last leg."""
    vehicle = opened()
    vehicle.commands.wait_ready()
    commands = vehicle.commands
    commands.clear()
    start = vehicle.location.global_relative_frame
    places = [beside(start, 5.0 * number, 5.0 * (number % 2)) for number in range(12)]
    for place in places:
        commands.add(Command(0, 0, 0, RELATIVE, 16, 0, 0, 0, 0, 0, 0, place.lat, place.lon, 30.0))
    commands.upload()
    arm_and_takeoff(vehicle, 30)
    vehicle.commands.next = 0
    while vehicle.mode.name != "AUTO":
        vehicle.mode = VehicleMode("AUTO")
        time.sleep(0.1)
    end_s = now() + 60  # the example, too, ends by its time
    while now() < end_s and vehicle.commands.next != len(places):
        time.sleep(0.1)
    while vehicle.mode.name != "RTL":
        vehicle.mode = VehicleMode("RTL")
        time.sleep(0.1)
    vehicle.close()


def guided_set_speed_yaw():
    vehicle = opened()
    encode = vehicle.message_factory

    def turn(heading, *, relative=False):
        order = encode.command_long_encode(0, 0, 115, 0, heading, 0, 1, int(relative), 0, 0, 0)
        vehicle.send_mavlink(order)

    def look_at(place):
        vehicle.send_mavlink(
            encode.command_long_encode(0, 0, 201, 0, 0, 0, 0, 0, place.lat, place.lon, place.alt)
        )

    def by_global_int(place):
        x, y = int(place.lat * 1e7), int(place.lon * 1e7)  # the example leaves them floats
        vehicle.send_mavlink(
            encode.set_position_target_global_int_encode(
                0, 0, 0, 6, 0b0000111111111000, x, y, place.alt, *[0] * 8
            )
        )

    def to_ned(north, east, down):
        vehicle.send_mavlink(
            encode.set_position_target_local_ned_encode(
                0, 0, 0, 1, 0b0000111111111000, north, east, down, *[0] * 8
            )
        )

    def go(north_m, east_m, by=vehicle.simple_goto):
        here = vehicle.location.global_relative_frame
        place = beside(here, north_m, east_m)
        by(place)
        far = metres_between(here, place)
        until(lambda: metres_between(vehicle.location.global_relative_frame, place) <= 0.01 * far)
        say("reached", north_m, east_m)

    def at_velocity(velocity, seconds, *, globally=False):
        if globally:
            message = encode.set_position_target_global_int_encode(
                0, 0, 0, 6, 0b0000111111000111, 0, 0, 0, *velocity, *[0] * 5
            )
        else:
            message = encode.set_position_target_local_ned_encode(
                0, 0, 0, 1, 0b0000111111000111, 0, 0, 0, *velocity, *[0] * 5
            )
        for _ in range(seconds):
            vehicle.send_mavlink(message)
            wait(1)

    arm_and_takeoff(vehicle, 5)
    vehicle.groundspeed = 5
    for north, east in ((80, -50), (0, 100), (-80, -50)):
        go(north, east)
    for speed, north, east in ((5, -100, -130), (15, 0, 260), (10, 100, -130)):
        vehicle.groundspeed = speed
        go(north, east, by_global_int)
    duration = 20
    to_ned(50, 0, -10)
    look_at(vehicle.location.global_relative_frame)
    wait(duration)
    to_ned(50, 50, -10)
    wait(duration)
    look_at(vehicle.location.global_relative_frame)
    to_ned(0, 50, -10)
    wait(duration)
    to_ned(0, 0, -10)
    wait(duration)
    squares = ((180, (-2, 0, -0.5)), (270, (0, -2, 0.5)), (0, (2, 0, 0)), (90, (0, 2, 0)))
    for heading, velocity in squares:
        turn(heading)
        at_velocity(velocity, duration)
        say("heading", heading, vehicle.heading)
        at_velocity((0, 0, 0), 1)
    turn(225)
    at_velocity((-2, -2, -0.5), duration, globally=True)
    at_velocity((0, 0, 0), 1, globally=True)
    turn(90, relative=True)
    at_velocity((2, -2, 0.5), duration, globally=True)
    at_velocity((0, 0, 0), 1, globally=True)
    vehicle.home_location = vehicle.location.global_frame
    vehicle.commands.download()
    vehicle.commands.wait_ready()
    say("home", vehicle.home_location)
    for velocity in ((2, 2, 0), (-2, 2, 0)):
        turn(90, relative=True)
        at_velocity(velocity, duration, globally=True)
        at_velocity((0, 0, 0), 1, globally=True)
    vehicle.mode = VehicleMode("LAND")
    vehicle.close()


def mission_basic():
    vehicle = opened()
    commands = vehicle.commands
    commands.clear()
    commands.add(Command(0, 0, 0, RELATIVE, 22, 0, 0, 0, 0, 0, 0, 0, 0, 10))
    centre = vehicle.location.global_frame
    corners = [beside(centre, north, east) for north, east in ((50, -50), (50, 50), (-50, 50), (-50, -50))]
    for corner, height in zip((*corners, corners[3]), (11, 12, 13, 14, 14), strict=True):
        commands.add(Command(0, 0, 0, RELATIVE, 16, 0, 0, 0, 0, 0, 0, corner.lat, corner.lon, height))
    commands.upload()
    arm_and_takeoff(vehicle, 10)
    vehicle.commands.next = 0
    vehicle.mode = VehicleMode("AUTO")
    skipped = False
    while True:
        following = vehicle.commands.next
        if following == 3 and not skipped:
            vehicle.commands.next = 5
            skipped = True
        if following == 5:
            break
        time.sleep(0.1)
    say("skipped to", vehicle.commands.next)
    vehicle.mode = VehicleMode("RTL")
    vehicle.close()


def mission_import_export():
    vehicle = opened()
    until(lambda: vehicle.is_armable)
    home = vehicle.location.global_frame
    rows = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{home.lat}\t{home.lon}\t{home.alt}\t1"]
    commands_ = (22, 16, 16, 16)
    for number, command in enumerate(commands_, start=1):
        place = beside(home, 10.0 * number, 5.0)
        rows.append(
            f"{number}\t0\t3\t{command}\t0\t0\t0\t0\t{place.lat:.7f}\t{place.lon:.7f}\t{10 + number}\t1"
        )
    Path("mpmission.txt").write_text("\n".join(rows) + "\n")
    commands = vehicle.commands
    commands.clear()
    for row in rows[1:]:
        cell = row.split("\t")
        numbers = [float(text) for text in cell[4:11]]
        commands.add(Command(0, 0, 0, int(cell[2]), int(cell[3]), int(cell[1]), int(cell[11]), *numbers))
    vehicle.commands.upload()
    commands.download()
    commands.wait_ready()
    say("home", vehicle.home_location.lat == 0)
    for item in commands:
        say("item", item.seq, item.frame, item.command, round(item.x, 6), round(item.y, 6), item.z)
    vehicle.close()


def performance_test():
    vehicle = opened()
    seen = []

    def send():
        vehicle.send_mavlink(vehicle.message_factory.command_long_encode(1, 1, 201, 0, 0, 0, 0, 0, 0, 0, 0))

    @vehicle.on_message("COMMAND_ACK")
    def listen(vehicle, name, message):
        seen.append(message.result)
        send()

    send()
    wait(20)
    say("acknowledged", len(seen) > 20, set(seen))
    vehicle.close()


def reboot():
    vehicle = opened()
    vehicle.reboot()
    time.sleep(1)


def set_attitude_target():
    vehicle = opened()

    def lean(pitch_deg=0.0, thrust=0.5, seconds=0.0):
        """The example's order of two messages: the lean, and level with the yaw rate."""
        yaw, pitch = vehicle.attitude.yaw / 2.0, math.radians(pitch_deg) / 2.0
        w, z, cosine, sine = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
        leaning = [cosine * w, -sine * z, sine * w, cosine * z]
        end_s = now() + seconds
        while True:
            send(0b00000100, leaning, thrust)
            if now() >= end_s:
                break
            wait(0.1)
        send(0b00000000, [1.0, 0.0, 0.0, 0.0], thrust)

    def send(mask, attitude, thrust):
        vehicle.send_mavlink(
            vehicle.message_factory.set_attitude_target_encode(0, 1, 1, mask, attitude, 0, 0, 0, thrust)
        )

    until(lambda: vehicle.is_armable)
    vehicle.mode = VehicleMode("GUIDED_NOGPS")
    vehicle.armed = True
    while not vehicle.armed:
        vehicle.armed = True
        time.sleep(1)
    while (altitude := vehicle.location.global_relative_frame.alt) < 0.95 * 2.5:
        lean(thrust=0.6 if altitude >= 0.6 * 2.5 else 0.7)
        wait(0.2)
    lean(seconds=3)
    lean(-5, seconds=3.21)
    lean(5, seconds=3)
    vehicle.mode = VehicleMode("LAND")
    until(lambda: vehicle.mode.name == "LAND")
    vehicle.close()


def simple_goto():
    vehicle = opened()
    arm_and_takeoff(vehicle, 10)
    vehicle.airspeed = 3
    vehicle.simple_goto(LocationGlobalRelative(-35.361354, 149.165218, 20))
    wait(30)
    vehicle.simple_goto(LocationGlobalRelative(-35.363244, 149.168801, 20), groundspeed=10)
    wait(30)
    vehicle.mode = VehicleMode("RTL")
    until(lambda: vehicle.mode.name == "RTL")
    vehicle.close()


def vehicle_state():
    """The example's THR_MIN and THR_MID are of ArduCopter before 3.4; others take their place."""
    vehicle = opened()
    vehicle.wait_ready("autopilot_version")
    say("version", vehicle.version, vehicle.version.release_type())
    say("capabilities", vehicle.capabilities.mission_int, vehicle.capabilities.ftp)
    for name in ("location.global_frame", "location.local_frame", "attitude", "velocity", "gps_0", "gimbal"):
        value = vehicle
        for part in name.split("."):
            value = getattr(value, part)
        say(name, value)
    say("battery", vehicle.battery, "ekf", vehicle.ekf_ok, "armable", vehicle.is_armable)
    say(vehicle.rangefinder, vehicle.heading, vehicle.system_status.state, vehicle.groundspeed)
    say("mode", vehicle.mode.name, "armed", vehicle.armed)
    while not vehicle.home_location:
        vehicle.commands.download()
        vehicle.commands.wait_ready()
    place = vehicle.location.global_frame
    place.alt = 222.0
    vehicle.home_location = place
    vehicle.commands.download()
    vehicle.commands.wait_ready()
    say("home", vehicle.home_location.alt)
    vehicle.mode = VehicleMode("GUIDED")
    until(lambda: vehicle.mode.name == "GUIDED")
    until(lambda: vehicle.is_armable)
    seen = []

    def attitude_seen(vehicle, name, value):
        seen.append(value)

    vehicle.add_attribute_listener("attitude", attitude_seen)
    wait(2)
    vehicle.remove_attribute_listener("attitude", attitude_seen)
    say("attitudes", len(seen) > 2)
    modes = []

    @vehicle.on_attribute("mode")
    def mode_seen(vehicle, name, value):
        modes.append(value.name)

    vehicle.mode = VehicleMode("STABILIZE")
    until(lambda: "STABILIZE" in modes)
    anything = set()

    def any_seen(vehicle, name, value):
        anything.add(name)

    vehicle.add_attribute_listener("*", any_seen)
    wait(4)
    vehicle.remove_attribute_listener("*", any_seen)
    say("attributes", sorted(anything))
    say("speed", vehicle.parameters["WPNAV_SPEED"], len(list(vehicle.parameters.items())) > 1000)
    told = []

    @vehicle.parameters.on_attribute("WPNAV_SPEED")
    def parameter_seen(parameters, name, value):
        told.append(value)

    vehicle.parameters["WPNAV_SPEED"] = 600
    until(lambda: vehicle.parameters["WPNAV_SPEED"] == 600)
    until(lambda: 600 in told)
    vehicle.parameters["PILOT_SPEED_UP"] = 200
    until(lambda: vehicle.parameters["PILOT_SPEED_UP"] == 200)
    vehicle.close()


if __name__ == "__main__":
    globals()[sys.argv[1]]()
    say("done")
