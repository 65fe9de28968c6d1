"""Measure how many vehicles one core flies in real time, with their default telemetry over loopback sockets.

All of them fly a mission; each has its own door, as the autopilots' simulators have, and a ground station
that hears everything is connected to a common one. The figure is the processor time for a simulated second;
below one it is real time. The bar is 20 vehicles.

    python benchmarks/fleet.py [--count 20] [--seconds 20]
"""

from __future__ import annotations

import argparse
import sys
import threading
import time

from mission.link import MavlinkEndpoint, open_link
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, GeoPoint, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.server import Server, ServerUrl
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink.fleet import Fleet
from sim_vehicle.weather.wind import Wind

HOME = GeoPoint(28.05, -82.15, 20.0)


def fly(fleet: Fleet) -> None:
    """Load a long mission into each vehicle and start it."""
    for vehicle in fleet.vehicles:
        home = vehicle.home
        takeoff = MissionItem(
            Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, x=home.latitude_deg, y=home.longitude_deg, z=10.0
        )
        places = [
            MissionItem.waypoint(home.latitude_deg + 3e-4 * (k % 2), home.longitude_deg + 1e-5 * k, 10.0)
            for k in range(60)
        ]
        vehicle.pilot.load([takeoff, *places, MissionItem(Command.NAV_RETURN_TO_LAUNCH)])


def start(endpoint: MavlinkEndpoint, fleet: Fleet) -> None:
    """Arm all and begin their missions."""
    for vehicle in fleet.vehicles:
        for command, first in ((m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0), (m.MAV_CMD_MISSION_START, 0.0)):
            endpoint.send(m.MAVLink_command_long_message(vehicle.system_id, 1, command, 0, first, *[0.0] * 6))


def over_sockets(count: int, seconds: float) -> tuple[float, int, int]:
    """Return processor seconds for a simulated second, frames heard, and vehicles in the air at the end."""
    fleet = Fleet(get_vehicle("quad"), HOME, count, wind=Wind(3.0, 1.0, 1.0, seed=1))
    fly(fleet)
    doors: list[str | ServerUrl] = [
        ServerUrl("tcpin:127.0.0.1:0", frozenset((v.system_id,))) for v in fleet.vehicles
    ]
    heard = [0]
    with Server(fleet.vehicles, ["udpin:127.0.0.1:0", *doors]) as server:
        stop = threading.Event()

        def listen() -> None:
            """Count what comes; a process of its own would be fairer, but costs the figure less than 5 %."""
            endpoint = MavlinkEndpoint(
                open_link(server.urls[0].replace("udpin", "udpout")), 255, 190, wanted=()
            )
            endpoint.send(m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            time.sleep(0.3)
            start(endpoint, fleet)
            while not stop.is_set():
                endpoint.receive()
                time.sleep(0.05)
            heard[0] = endpoint.reader.frames

        ground = threading.Thread(target=listen, daemon=True)
        ground.start()
        server.run(limit_s=2.0)
        busy = time.process_time()
        began_s, began = server.now_s, time.monotonic()
        server.run(limit_s=seconds)
        busy = time.process_time() - busy
        simulated_s = server.now_s - began_s
        wall_s = time.monotonic() - began
        stop.set()
        ground.join()
    flying = sum(vehicle.pilot.armed for vehicle in fleet.vehicles)
    print(f"  {count} vehicles over sockets: {simulated_s:.1f} s simulated in {wall_s:.1f} s of wall time")
    return busy / simulated_s, heard[0], flying


def in_process(count: int, seconds: float) -> float:
    """Return how many times faster than real time the fleet is on the virtual clock."""
    fleet = Fleet(get_vehicle("quad"), HOME, count, wind=Wind(3.0, 1.0, 1.0, seed=1))
    fly(fleet)
    simulation = Simulation(fleet.vehicles)
    start(MavlinkEndpoint(simulation.open_link(), 255, 190), fleet)
    simulation.run(limit_s=1.0)
    began = time.process_time()
    simulation.run(limit_s=seconds)
    return seconds / (time.process_time() - began)


def main() -> None:
    """Measure and compare with the bar."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    load, heard, flying = over_sockets(options.count, options.seconds)
    print(f"  {load:.2f} processor seconds a simulated second; {heard} frames heard; {flying} in the air")
    print(f"  in process, on the virtual clock: {in_process(options.count, 60.0):.0f} times real time")
    met = load < 1.0 and flying == options.count
    print(f"bar, {options.count} vehicles in real time on one core: {'met' if met else 'MISSED'}")
    sys.exit(0 if met else 1)


if __name__ == "__main__":
    main()
