"""Measure what the page costs a flight, and how fast the studio plans.

    python benchmarks/page_speed.py [--case cost] [--case studio] [--rounds 5]

- *cost*: three quads over Miniberry-100, flown as fast as the machine can in this process: alone, with a page
  that nobody looks at, with ten viewers in another process, and with a further one that never reads. In
  turns, each as a ratio to alone in its round, wall and processor time; the median of the rounds counts.
- *studio*: from a changed draft to its plan over HTTP, the first of a process and later ones. Bars: 1 s for
  Miniberry-100, 3 s for Waterberry.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import multiprocessing
import socket
import threading
import time
from collections.abc import Iterator
from statistics import median
from typing import Any
from urllib.parse import urlsplit

from common import options_of
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from wbf_mission.events import EventStream
from wbf_mission.flight import fly
from wbf_mission.scenario import Scenario
from wbf_mission.web.server import LiveServer
from wbf_mission.web.studio import Studio
from wbf_mission.web.view import View

VIEWERS = 10
CASES = ("cost", "studio")
FLIGHT = Scenario(farm="miniberry-100", planner="lawnmower", vehicles=3, budget="5min", estimator="point")


def view_all(url: str, ready: Any) -> None:
    """Look at a page as ten viewers do, until it is gone."""

    def look() -> None:
        with (
            contextlib.suppress(ConnectionClosed, OSError),
            connect(url.replace("http", "ws") + "live", origin=url.rstrip("/"), max_size=None) as page,
        ):
            ready.release()
            for _ in page:
                pass

    threads = [threading.Thread(target=look) for _ in range(VIEWERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


@contextlib.contextmanager
def viewers(url: str) -> Iterator[None]:
    """Let ten viewers look from another process."""
    context = multiprocessing.get_context("spawn")
    ready = context.Semaphore(0)
    process = context.Process(target=view_all, args=(url, ready))
    process.start()
    for _ in range(VIEWERS):
        ready.acquire()
    yield
    process.join()


def never_reading(url: str) -> socket.socket:
    """Ask for the updates and read none of them."""
    where = urlsplit(url)
    client = socket.create_connection((where.hostname, where.port))
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    head = f"GET /live HTTP/1.1\r\nHost: {where.netloc}\r\nOrigin: {url.rstrip('/')}\r\n"
    head += "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    client.sendall((head + "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n").encode())
    return client


def flown(how: str) -> tuple[float, float]:
    """Fly once, looked at in some way; return wall and processor seconds of this process."""
    with contextlib.ExitStack() as stack:
        stream, looking = EventStream(), contextlib.ExitStack()
        if how != "alone":
            view = View()
            stream.listen(view.take)
            url = stack.enter_context(LiveServer(view)).url
            if how != "nobody":
                looking.enter_context(viewers(url))
            if how == "sleeper":
                stack.enter_context(contextlib.closing(never_reading(url)))
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        fly(FLIGHT, events=stream)
        taken = time.perf_counter() - wall_s, time.process_time() - cpu_s
    looking.close()
    return taken


def cost(rounds: int) -> None:
    """Print what being looked at costs a flight."""
    ways = ("alone", "nobody", "ten", "sleeper")
    flown("alone")
    taken = [{how: flown(how) for how in ways} for _ in range(rounds)]
    for how in ways[1:]:
        wall, cpu = (median(one[how][k] / one["alone"][k] for one in taken) for k in range(2))
        print(f"cost: {how}: {wall:.2f} of the wall time alone, {cpu:.2f} of its processor time")


def studio() -> None:
    """Print how long a changed draft takes to be planned."""
    for farm, bar_s in (("miniberry-100", 1.0), ("waterberry", 3.0)):
        made = Studio(Scenario(farm=farm))
        with contextlib.closing(made), LiveServer(View(), routes=made.routes(), home="studio") as server:
            made.begin(server)
            where = urlsplit(server.url)
            taken: dict[str, list[float]] = {}
            for planner in ("lawnmower", "spiral"):
                for wind_m_s in (0.0, 1.0, 2.0, 3.0, 4.0):
                    client = http.client.HTTPConnection(where.netloc, timeout=120.0)
                    body = {"farm": farm, "options": {"planner": planner, "wind_speed_m_s": wind_m_s}}
                    begun_s = time.perf_counter()
                    client.request("POST", "/api/plan", json.dumps(body), {"Origin": server.url.rstrip("/")})
                    answer = client.getresponse()
                    text = answer.read()
                    assert answer.status == 200 and b'"error":' not in text[:100], text[:200]
                    taken.setdefault(planner, []).append(time.perf_counter() - begun_s)
                    client.close()
        for planner, seconds in taken.items():
            later = median(seconds[1:])
            print(
                f"studio: {farm}, {planner}: {later:.2f} s, the first {seconds[0]:.2f} s"
                f" (bar {bar_s:g} s: {bar_s / later:.1f} of it)"
            )


def main() -> None:
    """Run the cases that are asked for."""
    parser = options_of(__doc__)
    parser.add_argument("--case", action="append", choices=CASES)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    for case in given.case or CASES:
        {"cost": lambda: cost(given.rounds), "studio": studio}[case]()


if __name__ == "__main__":
    main()
