"""Who talks to the vehicle at the other end of a link: we ourselves, or another library."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mission.ground.link import own_driver
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from wbf_mission.live.hosting import LinkHosting, links_of
from wbf_mission.scenario import Scenario

__all__ = ["Via", "via_named"]


class Via:
    """A way to a vehicle: our own transfers and orders; another way says where it differs."""

    def driver(self, url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
        """Open a link; return what transfers plans over it. LinkError if the link cannot be opened."""
        return own_driver(url, on_event, on_text)

    def check_count(self, vehicles: int) -> None:
        """Refuse more vehicles than can be flown together in this way, with LiveFlightError."""

    def check(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Refuse what cannot be done in this way with a vehicle that was heard, with LiveFlightError."""

    def hosting(
        self,
        heard: Sequence[tuple[str, Vehicle]],
        tlog: Path | None,
        *,
        agreed: bool,
        force: bool,
        note: Callable[[str], None],  # noqa: ARG002
    ) -> LinkHosting:
        """Return where the flight of the vehicles takes place, each behind its link."""
        return LinkHosting(links_of(heard), tlog, agreed, force)


def via_named(name: str) -> Via:
    """Return a way by its name, ``own`` or ``mavsdk``; MAVSDK is loaded only when it is asked for."""
    if name == "mavsdk":
        from wbf_mission.live.via_mavsdk.adapter import MavsdkVia

        return MavsdkVia()
    return Via()
