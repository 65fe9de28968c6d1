"""Runs the checks and makes the report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, TypeAlias

from geo.errors import WbfMissionError
from mission.errors import LinkError, TransferError
from mission.link import open_link
from mission.link.address import Link
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.model import GeoPoint
from mission.transfer import RemoteTransferError
from mission.transfer.driver import wait_readable
from mission.transfer.vehicles import Vehicle
from wbf_mission.addons.check import commands, identity, missions, parameters, transfers
from wbf_mission.addons.check.peer import CheckError, FailedError, Peer, SkippedError
from wbf_mission.addons.check.registry import Check, CheckResult, Verdict

_MODULES = (identity, commands, parameters, missions, transfers)
_GROUPS = ("identity", "command", "telemetry", "param", "mission", "transfer", "fly")


def all_checks() -> tuple[Check, ...]:
    """Return all checks in the order of their groups.

    >>> all_checks()[0].id
    'identity.heartbeat'
    """
    checks = (check for module in _MODULES for check in module.check)
    return tuple(sorted(checks, key=lambda check: _GROUPS.index(check.group)))


def chosen_checks(only: tuple[str, ...], *, fly: bool) -> tuple[Check, ...]:
    """Return the checks that `only` names by id or group (empty: all); CheckError for an unknown name."""
    checks = all_checks()
    known = {check.id for check in checks} | {check.group for check in checks}
    for name in only:
        if name not in known:
            groups = ", ".join(dict.fromkeys(check.group for check in checks))
            msg = f"unknown check {name!r}: give an id of 'wbf-mission check --list' or a group ({groups})"
            raise CheckError(msg)
    return tuple(
        check
        for check in checks
        if (fly or not check.flies) and (not only or check.id in only or check.group in only)
    )


_MISSION_GROUPS = frozenset({"mission", "transfer", "fly"})
OnResult = Callable[[CheckResult], None]


@dataclass(frozen=True, slots=True)
class CheckReport:
    """Results of the checks of one vehicle; `warnings` gives the reasons why plans could not be restored."""

    name: str
    vehicle: Vehicle
    results: tuple[CheckResult, ...]
    warnings: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all required checks passed."""
        return not any(result.bad for result in self.results)

    def result(self, check_id: str) -> CheckResult:
        """Return the result of a check by id; CheckError if the check was not run."""
        for result in self.results:
            if result.check.id == check_id:
                return result
        raise CheckError(f"check {check_id!r} was not run")

    def summary(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        verdicts = [result.verdict for result in self.results]
        return {
            "url": self.name,
            "system": self.vehicle.system_id,
            "component": self.vehicle.component_id,
            "autopilot": self.vehicle.profile.name,
            "vehicle_type": self.vehicle.vehicle_type,
            "passed": self.passed,
            "counts": {verdict.value: verdicts.count(verdict) for verdict in Verdict},
            "checks": [result.summary() for result in self.results],
            "warnings": list(self.warnings),
        }


def check_vehicle(
    link: str | Link,
    *,
    fly: bool = False,
    only: Iterable[str] = (),
    system_id: int | None = None,
    wait_s: float = 10.0,
    on_result: OnResult | None = None,
    clock: Callable[[], float] = time.monotonic,
    wait: Callable[[Link, float], None] = wait_readable,
) -> CheckReport:
    """Check the vehicle at the other end of a link.

    The vehicle is not armed unless `fly` is given. A vehicle that is already armed is refused. The vehicle's
    own plans are restored at the end.

    Parameters
    ----------
    link : str or Link
        An address as of `mission.link.parse_link_url`, or an open link, which stays open.
    fly : bool
        Also run the checks that arm and fly the vehicle.
    only : iterable of str
        Ids or groups of checks to run; empty for all.
    system_id : int, optional
        System id of the vehicle to check, if the link carries several vehicles.
    wait_s : float
        Timeout for the vehicle's heartbeat (s).
    on_result : callable, optional
        Called with each result when its check ends.
    clock, wait : callable
        See `wbf_mission.addons.check.peer.Peer`.

    Raises
    ------
    CheckError
        If an id or group in `only` is unknown, or the vehicle is armed.
    LinkError
        If the link cannot be opened or breaks.
    TransferError
        If no vehicle sends a heartbeat.

    Examples
    --------
    On the virtual clock of a simulation:

    >>> from mission.model import GeoPoint
    >>> from sim_vehicle.host.simulation import Simulation
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> from sim_vehicle.mavlink import SimVehicle
    >>> simulation = Simulation([SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15))])
    >>> link = simulation.open_link()
    >>> check_vehicle(link, only=["identity.heartbeat"], clock=link.clock, wait=link.wait).passed
    True
    """
    checks = chosen_checks(tuple(only), fly=fly)
    results: list[CheckResult] = []
    warnings: list[str] = []
    with ExitStack() as stack:
        if isinstance(link, str):
            link = open_link(link)
            stack.callback(link.close)
        peer = Peer(link, clock=clock, wait=wait)
        vehicle = peer.driver.wait_for_vehicle(wait_s, system_id=system_id)
        peer.sleep(1.5)
        if peer.armed:
            raise CheckError(f"{link.name}: the vehicle is armed; land and disarm it before the checks")
        _find_home(peer)
        kept = False
        for check in checks:
            if check.group in _MISSION_GROUPS and not kept:
                kept = True
                _keep_plans(peer, stack, warnings)
            result = _run(check, peer)
            if check.group in _MISSION_GROUPS:
                peer.settle()
            results.append(result)
            if on_result is not None:
                on_result(result)
    return CheckReport(link.name, vehicle, tuple(results), tuple(warnings))


def _keep_plans(peer: Peer, stack: ExitStack, warnings: list[str]) -> None:
    """Download the vehicle's plans and restore them when `stack` closes; failures are added to `warnings`."""
    try:
        plans = peer.driver.download()[0]
    except RemoteTransferError as error:
        warnings.append(f"the vehicle's plans could not be read, so they will not be restored: {error}")
        return

    def put_back() -> None:
        try:
            try:
                peer.put_back(plans)
            except TransferError:
                # A check left an upload open: the vehicle waits for it until its timer expires.
                peer.sleep(peer.profile.abort_s + 1.0)
                peer.put_back(plans)
        except TransferError as error:
            warnings.append(f"the vehicle's plans could not be restored: {error}")

    stack.callback(put_back)


_Where: TypeAlias = m.MAVLink_home_position_message | m.MAVLink_global_position_int_message


def _find_home(peer: Peer) -> None:
    """Read the vehicle's position, at which the missions of the checks start."""
    kinds: tuple[type[_Where], ...] = (m.MAVLink_home_position_message, m.MAVLink_global_position_int_message)
    for kind in kinds:
        message = peer.expect((kind,), 1.2)
        if message is None:
            message = peer.request(kind)
        if message is None:
            continue
        if is_a(message, m.MAVLink_home_position_message):
            position = (message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)
        else:
            position = (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
        if abs(position[0]) < 89.0 and abs(position[1]) < 179.0 and any(position[:2]):
            peer.home = GeoPoint(*position)
            return


def _run(check: Check, peer: Peer) -> CheckResult:
    began_s = peer.now()
    verdict = Verdict.PASSED
    try:
        peer.forget()
        detail = check.function(peer) or ""
    except FailedError as error:
        verdict, detail = Verdict.FAILED, str(error)
    except SkippedError as error:
        verdict, detail = Verdict.SKIPPED, str(error)
    except LinkError:
        raise
    except WbfMissionError as error:
        verdict, detail = Verdict.FAILED, str(error)
    return CheckResult(check, check.requirement(peer.profile), verdict, detail, peer.now() - began_s)
