"""Measure the time of the studio from a changed draft to the plan, over HTTP.

The first plan of a process and later plans are timed. Limits: 1 s for Miniberry-100, 3 s for Waterberry.

    python benchmarks/page_speed.py
"""

from __future__ import annotations

import contextlib
import http.client
import json
import time
from statistics import median
from urllib.parse import urlsplit

from common import options_of

from wbf_mission.addons.web.server import LiveServer
from wbf_mission.addons.web.studio import Studio
from wbf_mission.addons.web.view import View
from wbf_mission.scenario import Scenario


def main() -> None:
    """Print the planning times of changed drafts."""
    options_of(__doc__).parse_args()
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


if __name__ == "__main__":
    main()
