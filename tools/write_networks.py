"""Train the networks of the estimator `epidemic` that the package includes: Miniberry farms, days 0 to 23.

Run it after a change of the training. It takes about 35 s of processor time a network::

    python tools/write_networks.py
"""

from __future__ import annotations

from geo.farms import get_farm
from wbf_mission.addons.epidemic.estimator import EpidemicEstimator
from wbf_mission.addons.epidemic.store import INCLUDED

FARMS = ("miniberry-10", "miniberry-30", "miniberry-100")
DAYS = (0, 8, 16)
"""First days of the blocks of eight days."""


def main() -> None:
    """Replace the networks."""
    INCLUDED.mkdir(exist_ok=True)
    for old in INCLUDED.iterdir():
        old.unlink()
    for farm in FARMS:
        EpidemicEstimator(cache=INCLUDED).fit(get_farm(farm).grid()).prepare(DAYS)
    for lock in INCLUDED.glob("*.lock"):
        lock.unlink()


if __name__ == "__main__":
    main()
