"""A live page as a process of its own, which can be stopped: it tells its address, then what is ordered."""

from __future__ import annotations

import itertools
import sys
import time

from geo.farms import get_farm
from sensors.fields import PAPER_FIELDS
from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.view import View
from wbf_mission.events import EventStream, Noted, RunBegun, VehicleInfo, VehicleMoved
from wbf_mission.run.orders import Orders


def say(*words: object) -> None:
    """Write a line."""
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Fly two vehicles in circles until the input ends."""
    stream, view = EventStream(), View()
    orders = Orders(stream)
    stream.listen(lambda event: say("warned:", event.text) if event.warns else None, Noted)
    stream.listen(view.take)
    vehicles = tuple(VehicleInfo(number, f"drone-{number}", "copter") for number in (1, 2))
    stream.tell(RunBegun("a flight", get_farm("miniberry-10"), PAPER_FIELDS, vehicles, simulated=False))
    orders.allow(("arm", "hold", "resume", "return", "land"), {1, 2})
    with LiveServer(view, orders=orders) as server:
        say(server.url)
        for step in itertools.count():
            for number in (1, 2):
                place = 1.0 + 0.02 * (step % 50), float(number)
                moved = VehicleMoved(
                    step / 10, 1, 1, number, *place, 5.0, 3.0, battery=0.75, mode="AUTO", armed=True
                )
                stream.tell(moved)
            for order in orders.taken():
                say("taken:", order.order, *order.system_ids)
            time.sleep(0.1)


if __name__ == "__main__":
    sys.exit(main())
