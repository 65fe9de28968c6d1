"""Measure mission uploads: 1000 items on loopback by our client and by MAVSDK.

Over loopback TCP (our client) and UDP (MAVSDK) the vehicle runs in a process of its own; the bar is 0.5 s for
the upload alone.

    python benchmarks/uploads.py [--items 1000] [--autopilot px4]
"""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from common import options_of

from mission.link import MavlinkEndpoint, open_link
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import MissionDownload, MissionUpload
from mission.transfer.driver import TransferDriver
from sim_vehicle.autopilot import autopilot_names, get_autopilot

BAR_S = 0.5
HOME = GeoPoint(28.05, -82.15, 20.0)


def plan(number: int) -> tuple[MissionItem, ...]:
    """Return a mission with different places."""
    return tuple(MissionItem.waypoint(28.05 + 1e-6 * k, -82.15 + 1e-6 * (k % 7), 10.0) for k in range(number))


@contextmanager
def simulator(autopilot: str, url: str) -> Iterator[str]:
    """Run ``wbf-mission sim`` in a process and yield the address that it took."""
    command = [sys.executable, "-m", "wbf_mission", "sim", "--no-camera", "--autopilot", autopilot]
    process = subprocess.Popen([*command, "--listen", url], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        greeting = process.stderr.readline()
        found = re.search(r"((?:tcpin|udpout|udpin):\S+?)[;,]", greeting)
        if found is None:
            sys.exit(f"the simulator did not start: {greeting}")
        yield found[1]
    finally:
        process.terminate()
        process.wait()
        process.stderr.close()


def by_our_client(items: tuple[MissionItem, ...], autopilot: str) -> tuple[float, float]:
    """Return the seconds of an upload and of a download over TCP, the best of three."""
    best = [float("inf"), float("inf")]
    with simulator(autopilot, "tcpin:127.0.0.1:0") as url:
        link = open_link(url.replace("tcpin", "tcp"))
        with TransferDriver(MavlinkEndpoint(link, 255, 190)) as driver:
            driver.wait_for_vehicle()
            options = {
                "target": (1, 1),
                "source": (255, 190),
                "profile": get_autopilot(autopilot).for_vehicle("multirotor").profile,
            }
            for _ in range(3):
                for number, transfer in enumerate(
                    (
                        MissionUpload(items, home=HOME, **options),
                        MissionDownload(MissionType.MISSION, **options),
                    )
                ):
                    began = time.perf_counter()
                    driver.run(transfer)
                    best[number] = min(best[number], time.perf_counter() - began)
    return best[0], best[1]


def by_mavsdk(items: tuple[MissionItem, ...], autopilot: str) -> float:
    """Return the seconds of an upload by MAVSDK over UDP, the best of three."""
    import mavsdk
    from mavsdk.plugins.mission_raw import MissionItem as RawItem
    from mavsdk.plugins.mission_raw import MissionRaw

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with simulator(autopilot, f"udpout:127.0.0.1:{port}"):
        client = mavsdk.Mavsdk(
            mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
        )
        client.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = client.first_autopilot(15.0)
        if system is None:
            sys.exit("MAVSDK does not find the vehicle")
        plugin = MissionRaw(system)
        sent = [
            RawItem(
                k,
                3,
                item.command,
                int(k == 0),
                1,
                0.0,
                0.0,
                0.0,
                0.0,
                item.wire_x(),
                item.wire_y(),
                item.z,
                0,
            )
            for k, item in enumerate(items)
        ]
        best = float("inf")
        for _ in range(3):
            began = time.perf_counter()
            plugin.upload_mission(sent)
            best = min(best, time.perf_counter() - began)
        client.destroy()
        return best


def main() -> None:
    """Measure everything and compare it with the bar."""
    parser = options_of(__doc__)
    parser.add_argument("--items", type=int, default=1000)
    parser.add_argument("--autopilot", choices=autopilot_names(), default="px4")
    options = parser.parse_args()
    items, autopilot = plan(options.items), options.autopilot
    up, down = by_our_client(items, autopilot)
    theirs = by_mavsdk(items, autopilot)
    print(f"{autopilot}, {len(items)} items, loopback, the vehicle in its own process")
    print(f"  our client: up {up:.3f} s ({len(items) / up:.0f} items/s), down {down:.3f} s")
    print(f"  MAVSDK:     up {theirs:.3f} s ({len(items) / theirs:.0f} items/s)")
    met = max(up, theirs) < BAR_S * len(items) / 1000
    print(f"bar {BAR_S} s for 1000: {'met' if met else 'MISSED'}")
    sys.exit(0 if met else 1)


if __name__ == "__main__":
    main()
