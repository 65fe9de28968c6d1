"""Driver that runs transfers over a real link, and blocks until they end."""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from geo.system import Closing
from mission.link.address import Link, MavlinkEndpoint
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import is_a
from mission.model import GeoPoint, Mission, MissionType
from mission.transfer import wire
from mission.transfer.client import ClientTimers
from mission.transfer.events import (
    DownloadComplete,
    Event,
    Output,
    RemoteTransferError,
    Transfer,
    TransferFailed,
    TransferStatistics,
)
from mission.transfer.rendering import Rendered, refuse_errors, render
from mission.transfer.round_trip import RoundTrip
from mission.transfer.upload import NO_MISSION_LEFT, MissionClear, gives_up_mission
from mission.transfer.vehicles import Vehicle, VehicleSearch, vehicle_of
from mission.transfer.verified import OWN_TRANSFERS, TransferMaker

OnEvent = Callable[[Event], None]
OnText = Callable[[mavlink.MAVLink_statustext_message, float], None]
_HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_CURRENT = mavlink.MAVLINK_MSG_ID_MISSION_CURRENT
_WANTED = wire.CLIENT_MESSAGES | {_HEARTBEAT, _CURRENT}
_STATUSTEXT = mavlink.MAVLINK_MSG_ID_STATUSTEXT
_HEARTBEAT_S = 1.0
_TEXT_WAIT_S = 0.5
_LONGEST_WAIT_S = 0.25
_BEAT_WAIT_S = 2.5
_FEWEST_FRAMES = 5
_ORDER = (MissionType.FENCE, MissionType.RALLY, MissionType.MISSION)


def wait_readable(link: Link, seconds: float) -> None:
    """Wait until the link has data, at most ``seconds``."""
    number = link.fileno()
    if number is None:
        time.sleep(min(seconds, 0.001))
    else:
        select.select([number], [], [], seconds)


class TransferDriver(Closing):
    """Blocking transfers of plans with one vehicle.

    While waiting, the driver sends a ground station heartbeat each second: vehicles expect heartbeats, and
    know the address of a ``udpout`` link only after the first datagram. Ctrl-C also cancels the transfer in
    progress on the vehicle.

    Parameters
    ----------
    endpoint : MavlinkEndpoint
        Endpoint to use. The message ids that transfers need are added to the wanted ids of its reader.
    clock : callable
        Monotonic clock (s).
    wait : callable
        ``wait(link, seconds)`` returns when data may have arrived, at the latest after ``seconds``.
    on_event : callable, optional
        Called with each event, for a progress bar.
    maker : TransferMaker
        Factory of the transfers.
    heartbeat : bool
        Whether to send ground station heartbeats; False if the link sends them.
    on_text : callable, optional
        Called with each STATUSTEXT of the vehicle and the time. If it is given, the driver waits briefly for
        a text after a failure.
    """

    def __init__(
        self,
        endpoint: MavlinkEndpoint,
        *,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[Link, float], None] = wait_readable,
        timers: ClientTimers | None = None,
        on_event: OnEvent | None = None,
        maker: TransferMaker = OWN_TRANSFERS,
        heartbeat: bool = True,
        on_text: OnText | None = None,
    ) -> None:
        self.endpoint = endpoint
        self.timers = ClientTimers() if timers is None else timers
        self.vehicle: Vehicle | None = None
        self._clock = clock
        self._wait = wait
        self._on_event = on_event
        self._on_text = on_text
        self._round_trip = RoundTrip()
        self._maker = maker
        self._heartbeat_s = -1e9 if heartbeat else math.inf
        wanted = _WANTED if on_text is None else _WANTED | {_STATUSTEXT}
        reader = endpoint.reader
        reader.wanted = wanted if reader.wanted is None else reader.wanted | wanted

    def close(self) -> None:
        """Close the endpoint."""
        self.endpoint.close()

    def wait_for_vehicle(
        self, timeout_s: float = 10.0, *, system_id: int | None = None, besides: Collection[int] = ()
    ) -> Vehicle:
        """Wait for a heartbeat of autopilot ``system_id`` (None: of any autopilot not in ``besides``).

        Raises NoVehicleError if no such heartbeat arrives in time, LinkError if the link fails.
        """
        end_s = self._clock() + timeout_s
        search = VehicleSearch(system_id, besides)
        while True:
            for message in self.endpoint.receive():
                if (found := search.take(message)) is not None:
                    self.vehicle = found
                    return found
            now_s = self._clock()
            if now_s >= end_s:
                raise search.failure(self.endpoint.link.name, timeout_s)
            self._beat(now_s)
            self._wait(self.endpoint.link, min(end_s - now_s, _LONGEST_WAIT_S))

    def run(self, transfer: Transfer) -> tuple[Event, TransferStatistics]:
        """Run one transfer to its end; return its last event and its statistics.

        Raises RemoteTransferError with the text of `TransferFailed`, and LinkError if the link fails.
        """
        try:
            last = self._emit(transfer.start(self._clock()))
            while not transfer.done:
                last = self._turn(transfer) or last
        except KeyboardInterrupt:
            if not transfer.done:
                self._emit(transfer.cancel(self._clock()))
            raise
        assert last is not None
        if isinstance(last, TransferFailed):
            # The vehicle's STATUSTEXT about the failure may follow its ACK.
            end_s = self._clock() + _TEXT_WAIT_S
            while self._on_text is not None and (rest_s := end_s - self._clock()) > 0.0:
                self._wait(self.endpoint.link, rest_s)
                for message in self.endpoint.receive():
                    self._note(message)
            raise RemoteTransferError(last.text, last)
        return last, transfer.statistics()

    def _turn(self, transfer: Transfer) -> Event | None:
        last: Event | None = None
        # Gaps in the sequence numbers of the vehicle's frames give the frame loss of the link.
        vehicle, sources = self.vehicle, self.endpoint.reader.sources
        heard = None if vehicle is None else sources.get((vehicle.system_id, vehicle.component_id))
        if heard is not None and heard.received >= _FEWEST_FRAMES:
            self._round_trip.loss = heard.lost / (heard.lost + heard.received)
        for message in self.endpoint.receive():
            self._note(message)
            last = self._emit(transfer.receive(message, self._clock())) or last
        now_s = self._clock()
        last = self._emit(transfer.poll(now_s)) or last
        deadline_s = transfer.next_deadline()
        if deadline_s is not None:
            self._beat(now_s)
            self._wait(self.endpoint.link, min(max(deadline_s - now_s, 0.0), _LONGEST_WAIT_S))
        return last

    def _note(self, message: Message) -> None:
        """Update the armed state from a heartbeat, and forward a STATUSTEXT of the vehicle."""
        heard = vehicle_of(message)
        if heard is not None and heard == self.vehicle:
            self.vehicle = heard
        if (
            self._on_text is not None
            and self.vehicle is not None
            and is_a(message, mavlink.MAVLink_statustext_message)
            and message.get_srcSystem() == self.vehicle.system_id
        ):
            self._on_text(message, self._clock())

    def _armed_now(self) -> bool:
        """Return whether a fresh heartbeat shows the vehicle armed; a silent vehicle counts as armed.

        Heartbeats that wait on the link may be minutes old, for example after a question to the operator.
        """
        end_s = self._clock() + _BEAT_WAIT_S
        fresh = False
        while self._clock() < end_s:
            messages = self.endpoint.receive()
            for message in messages:
                self._note(message)
            if fresh and any(vehicle_of(message) == self.vehicle for message in messages):
                return self.vehicle is None or self.vehicle.armed
            if not messages:
                fresh = True
                self._beat(self._clock())
                self._wait(self.endpoint.link, _LONGEST_WAIT_S)
        return True

    def _emit(self, output: Output) -> Event | None:
        for message in output.messages:
            self.endpoint.send(message)
        if self._on_event is not None:
            for event in output.events:
                self._on_event(event)
        return output.events[-1] if output.events else None

    def _beat(self, now_s: float) -> None:
        if now_s >= self._heartbeat_s + _HEARTBEAT_S:
            self._heartbeat_s = now_s
            self.endpoint.send(wire.ground_heartbeat())

    def _options(self) -> dict[str, Any]:
        vehicle = self.vehicle or self.wait_for_vehicle()
        return {
            "target": (vehicle.system_id, vehicle.component_id),
            "source": (self.endpoint.system_id, self.endpoint.component_id),
            "profile": vehicle.profile,
            "timers": self.timers,
            "round_trip": self._round_trip,
        }

    def render(self, mission: Mission, *, parameters: Mapping[str, float] | None = None) -> Rendered:
        """Return a mission converted for the autopilot, with remarks (`mission.transfer.rendering`).

        ``parameters`` are the known parameters of the vehicle. Raises the errors of `wait_for_vehicle`.
        """
        vehicle = self.vehicle or self.wait_for_vehicle()
        return render(mission, vehicle.profile, vehicle.vehicle_type, parameters=parameters)

    def upload(
        self,
        mission: Mission,
        *,
        types: Iterable[MissionType] | None = None,
        force: bool = False,
        parameters: Mapping[str, float] | None = None,
    ) -> tuple[TransferStatistics, ...]:
        """Upload the plans of a mission in the form that the autopilot accepts (`render`), and verify them.

        Fence and rally points are sent first, so that the vehicle checks the new mission against the new
        fence. PX4 would check its old mission against the new fence, too. Therefore PX4's old mission is
        cleared before, if a fresh heartbeat shows that the vehicle is disarmed.

        Parameters
        ----------
        types : iterable of MissionType, optional
            Plans to send. Default: the mission, and fence and rally points if the mission has any.
        force : bool
            Whether to send items that the autopilot would refuse or not fly.
        parameters : mapping of str to float, optional
            Known parameters of the vehicle. Some of them decide whether the autopilot refuses an item.

        Raises
        ------
        LocalTransferError
            If a plan cannot be sent, or the autopilot would refuse it; nothing has been sent in that case.
        RemoteTransferError
            If the vehicle refuses, does not answer, or holds a different plan afterwards.
        LinkError
            If the link fails.
        """
        wanted = {MissionType.MISSION, *(kind for kind in _ORDER if mission.plan(kind))}
        chosen = wanted if types is None else set(types)
        options = self._options()
        vehicle = self.vehicle or self.wait_for_vehicle()
        rendered = self.render(mission, parameters=parameters)
        if not force:
            refuse_errors(rendered)
        chosen_kinds = [kind for kind in _ORDER if kind in chosen]
        costs: list[TransferStatistics] = []
        # Transfers by MAVSDK do not clear the old mission first.
        cleared = (
            self._maker is OWN_TRANSFERS
            and gives_up_mission(rendered.mission, chosen, vehicle.profile, armed=False)
            and not self._armed_now()
        )
        if cleared:
            self.run(self._maker.upload((), MissionType.MISSION, **options))
        uploads = [
            self._maker.upload(
                rendered.mission.plan(kind),
                kind,
                home=mission.home,
                origins=rendered.origins_of(kind),
                **options,
            )
            for kind in chosen_kinds
        ]
        for upload in uploads:
            try:
                costs.append(self.run(upload)[1])
            except RemoteTransferError as error:
                new = " and ".join(cost.mission_type.name.lower() for cost in costs)
                held = [f"the vehicle holds the new {new}"] * bool(new) + [NO_MISSION_LEFT] * cleared
                raise RemoteTransferError("; ".join([str(error), *held]), error.failure) from error
        return tuple(costs)

    def mission_state(self, listen_s: float = 1.0) -> int | None:
        """Return the last MISSION_STATE that arrives within ``listen_s``, or None if none arrives.

        PX4 acknowledges a mission before it checks feasibility. An infeasible mission is stored, but its
        state is MISSION_STATE_NO_MISSION, and PX4 refuses the mission mode. The vehicle's STATUSTEXTs are
        forwarded.
        """
        vehicle = self.vehicle or self.wait_for_vehicle()
        target = (vehicle.system_id, vehicle.component_id)
        state, trip_s, asked_s = 0, self._round_trip.known_s or 0.0, -math.inf
        end_s = self._clock() + listen_s + trip_s
        while (now_s := self._clock()) < end_s:
            if now_s >= asked_s + listen_s / 3.0:
                asked_s = now_s
                self.endpoint.send(wire.command_long(target, mavlink.MAV_CMD_REQUEST_MESSAGE, _CURRENT))
            self._beat(now_s)
            self._wait(self.endpoint.link, min(end_s - now_s, _LONGEST_WAIT_S))
            for message in self.endpoint.receive():
                self._note(message)
                if (
                    is_a(message, mavlink.MAVLink_mission_current_message)
                    and message.get_srcSystem() == vehicle.system_id
                ):
                    state = message.mission_state
        return state or None

    def download(
        self, *, types: Iterable[MissionType] = tuple(MissionType)
    ) -> tuple[Mission, tuple[TransferStatistics, ...]]:
        """Download the vehicle's plans.

        If the vehicle answers UNSUPPORTED for fence or rally points, these plans are returned empty. Raises
        RemoteTransferError if the vehicle refuses or does not answer, LinkError if the link fails.
        """
        plans: dict[MissionType, DownloadComplete] = {}
        costs: list[TransferStatistics] = []
        options = self._options()
        for kind in types:
            try:
                end, cost = self.run(self._maker.download(kind, **options))
            except RemoteTransferError as error:
                result = None if error.failure is None else error.failure.result
                if kind == MissionType.MISSION or result != wire.UNSUPPORTED:
                    raise
                continue
            costs.append(cost)
            if isinstance(end, DownloadComplete):
                plans[kind] = end
        home: GeoPoint | None = plans[MissionType.MISSION].home if MissionType.MISSION in plans else None
        parts = {kind: plans[kind].items if kind in plans else () for kind in MissionType}
        mission = Mission(
            parts[MissionType.MISSION],
            home=home,
            fence=parts[MissionType.FENCE],
            rally=parts[MissionType.RALLY],
        )
        return mission, tuple(costs)

    def clear(self, types: Iterable[MissionType] = tuple(MissionType)) -> tuple[TransferStatistics, ...]:
        """Clear the plans; raises the errors of `download`."""
        options = self._options()
        return tuple(self.run(MissionClear(kind, **options))[1] for kind in types)
