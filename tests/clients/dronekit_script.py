"""A script as people write them with DroneKit; the address is its argument.

DroneKit 2.9.2 was written for Python before 3.10, which took `collections.MutableMapping` away.
"""

import collections
import collections.abc
import math
import sys
import time

collections.MutableMapping = collections.abc.MutableMapping
collections.Callable = collections.abc.Callable

from dronekit import Command, LocationGlobalRelative, VehicleMode, connect  # noqa: E402
from pymavlink import mavutil  # noqa: E402


def tell(text):
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def until(condition, what, limit_s=60.0):
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, what
        time.sleep(0.02)
    tell(what)


def condition_yaw(vehicle, heading, relative=False):
    """As in DroneKit's guide, "Guiding and controlling Copter"."""
    message = vehicle.message_factory.command_long_encode(
        0, 0, mavutil.mavlink.MAV_CMD_CONDITION_YAW, 0, heading, 0, 1, 1 if relative else 0, 0, 0, 0
    )
    vehicle.send_mavlink(message)


vehicle = connect(sys.argv[1], wait_ready=True, heartbeat_timeout=30, timeout=60)
tell(f"connected {vehicle.version}")
until(lambda: vehicle.is_armable, "armable")
vehicle.parameters["WPNAV_SPEED"] = 600
until(lambda: vehicle.parameters["WPNAV_SPEED"] == 600, "parameter set")
home = vehicle.location.global_relative_frame
vehicle.mode = VehicleMode("GUIDED")
until(lambda: vehicle.mode.name == "GUIDED", "guided")
vehicle.armed = True
until(lambda: vehicle.armed, "armed")
vehicle.simple_takeoff(10)
until(lambda: vehicle.location.global_relative_frame.alt > 9.5, "aloft")
vehicle.send_mavlink(vehicle.message_factory.command_long_encode(0, 0, 511, 0, 158, 100000, 0, 0, 0, 0, 0))
vehicle.gimbal.rotate(-45, 0, 30)
until(lambda: (vehicle.gimbal.pitch, vehicle.gimbal.yaw) == (-45, 30), "gimbal turned")
vehicle.simple_goto(LocationGlobalRelative(home.lat + 0.001, home.lon, 10), groundspeed=5)
until(lambda: vehicle.groundspeed > 3.0, "under way")
condition_yaw(vehicle, 90)
until(lambda: abs(vehicle.heading - 90) < 6 and vehicle.groundspeed > 2.0, "looks aside under way")
vehicle.mode = VehicleMode("CIRCLE")
until(lambda: vehicle.mode.name == "CIRCLE", "circle")
vehicle.mode = VehicleMode("GUIDED")
until(lambda: vehicle.mode.name == "GUIDED", "guided again")
for _ in range(10):
    vehicle.send_mavlink(
        vehicle.message_factory.set_attitude_target_encode(
            0, 1, 1, 0b00000111, [math.cos(0.1), math.sin(0.1), 0.0, 0.0], 0, 0, 0, 0.5
        )
    )
    time.sleep(0.05)
until(lambda: vehicle.attitude.roll > 0.15, "leans")
commands = vehicle.commands
commands.download()
commands.wait_ready(timeout=30)
commands.clear()
relative = mavutil.mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
for north in (0.0002, 0.0001):
    commands.add(Command(0, 0, 0, relative, 16, 0, 0, 0, 0, 0, 0, home.lat + north, home.lon + 0.0001, 12))
commands.upload(timeout=30)
commands.download()
commands.wait_ready(timeout=30)
assert commands.count == 2, commands.count
tell("mission kept")
vehicle.mode = VehicleMode("AUTO")
until(lambda: commands.next == 2, "second waypoint")
vehicle.mode = VehicleMode("RTL")
until(lambda: not vehicle.armed, "home", 120.0)
vehicle.close()
