"""Measure how long runs take in which a policy decides, or which last for days.

    python benchmarks/policy_speed.py [--case policy] [--case fleet] [--case days] [--cold]

- *policy*: ten minutes of Miniberry-100 by one quad, `greedy`, a decision about every 4 s. The second run of
  a process: nothing has to be compiled, learned or generated any more. Bar: 100 times real time.
- *fleet*: Waterberry by three quads with one battery each, `greedy`, a decision about every 10 s; the whole
  process. Bar: 3 minutes.
- *days*: 15 days of Miniberry-100, two flights a day with the whole battery each; the whole process. Bar:
  1 minute.

Each is told in seconds of wall and processor time, as a ratio to its bar (1 and more: reached), and with the
parts of the wall time. Where others use the machine, too, wall time says little: the ratio by processor time
is what one core of one's own would reach; *days* uses several. With ``--cold`` the whole processes run with
an empty cache: they compile, generate the environment and train.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass

from scratch import scratch_folder

from wbf_mission.flight import fly
from wbf_mission.scenario import Scenario

POLICY_BAR = 100.0
FLEET_BAR_S, DAYS_BAR_S = 180.0, 60.0
# Three quads that take about twelve pictures a second each: so many come in ten seconds.
FLEET = ("--farm", "waterberry", "--policy", "greedy:every=370", "--vehicles", "3")
DAYS = ("--farm", "miniberry-100", "--days", "15", "--flights-per-day", "2")


@dataclass(frozen=True, slots=True)
class Taken:
    """What a run took: wall and processor seconds, the wall seconds of its parts; and what it gave."""

    wall_s: float
    cpu_s: float
    simulated_s: float
    decisions: int
    parts_s: dict[str, float]

    def lines(self, name: str, bar: str, bar_s: float) -> str:
        """Return what people read; the bar is in wall seconds."""
        ratio = self.simulated_s / self.wall_s
        parts = sorted(self.parts_s.items(), key=lambda part: -part[1])
        told = ", ".join(f"{part} {seconds / self.wall_s:.0%}" for part, seconds in parts)
        return (
            f"{name}: {self.wall_s:.1f} s wall, {self.cpu_s:.1f} s CPU, {self.simulated_s:.0f} s flown"
            f" with {self.decisions} decisions, {ratio:.0f} x real time"
            f" ({self.simulated_s / self.cpu_s:.0f} x by CPU)\n"
            f"  bar {bar}: reached {bar_s / self.wall_s:.2f} of it by wall time,"
            f" {bar_s / self.cpu_s:.2f} by CPU on one core\n"
            f"  parts: {told}"
        )


def policy() -> Taken:
    """Fly in this process, twice; the second run counts."""
    scenario = Scenario(farm="miniberry-100", policy="greedy", budget="10min")
    fly(scenario)
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    result = fly(scenario)
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    return Taken(wall_s, cpu_s, result.simulated_s, len(result.decisions), result.timings_s)


def process(arguments: tuple[str, ...], cold: bool) -> Taken:
    """Run the command line in a process of its own."""
    with scratch_folder() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": f"{folder}/cache"} if cold else dict(os.environ)
        command = [sys.executable, "-m", "wbf_mission", "fly", *arguments, "--json", "--quiet"]
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(
            [*command, "--out", f"{folder}/run"], capture_output=True, text=True, env=environment, check=False
        )
        wall_s, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stderr}")
    summary = json.loads(done.stdout)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    simulated_s = summary["realtime_factor"] * summary["timings_s"]["flight"]
    return Taken(wall_s, cpu_s, simulated_s, len(summary["decisions"]), summary["timings_s"])


def main() -> int:
    """Run the cases and say how they compare with their bars."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", action="append", choices=("policy", "fleet", "days"))
    parser.add_argument("--cold", action="store_true", help="with an empty cache")
    arguments = parser.parse_args()
    cases = arguments.case or ["policy", "fleet", "days"]
    good = True
    if "policy" in cases:
        taken = policy()
        bar_s = taken.simulated_s / POLICY_BAR
        print(taken.lines("policy", f"{POLICY_BAR:.0f} x real time", bar_s), flush=True)
        good &= taken.wall_s <= bar_s
    for name, options, bar_s in (("fleet", FLEET, FLEET_BAR_S), ("days", DAYS, DAYS_BAR_S)):
        if name in cases:
            taken = process(options, arguments.cold)
            print(taken.lines(name, f"{bar_s:.0f} s", bar_s), flush=True)
            good &= taken.wall_s <= bar_s
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
