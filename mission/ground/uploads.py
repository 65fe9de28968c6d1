"""Uploads before the flight: fence, rally points and mission, one after the other, sans-IO."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from mission.ground.contact import Contact
from mission.link.codec.dialect import Message
from mission.model import Mission, MissionType
from mission.transfer import (
    NO_MISSION_LEFT,
    FailureReason,
    LocalTransferError,
    Output,
    Progress,
    Rendered,
    Transfer,
    TransferFailed,
    TransferStatistics,
    UploadVerified,
    gives_up_mission,
    refuse_errors,
    render,
)

_AN_ITEM_S = 0.1
_LAST_WORDS_S = 0.5


class PlanUploads:
    """Verified uploads of the plans of a mission to a vehicle on the ground.

    Fence and rally points, if any, are uploaded before the mission items. Without a shared round trip time,
    each upload measures the round trip time itself.
    """

    def __init__(
        self,
        mission: Mission,
        contact: Contact,
        *,
        on_progress: Callable[[int, int], None] | None = None,
        force: bool = False,
    ) -> None:
        self.statistics: list[TransferStatistics] = []  # Statistics of each upload.
        self.failure = ""  # Reason of a failed upload, empty if none failed.
        self._rendered = Rendered(mission, (), tuple(range(len(mission.items))))
        self._force = force
        self._ending: tuple[str, float] | None = None
        self.fell_silent = False  # whether the failure is a timeout
        self._contact = contact
        self._on_progress = on_progress
        self._kinds = deque(
            kind
            for kind in (MissionType.FENCE, MissionType.RALLY, MissionType.MISSION)
            if mission.plan(kind) or kind is MissionType.MISSION
        )
        self._clears = False  # whether the old mission is cleared first
        self._transfer: Transfer | None = None

    @property
    def mission(self) -> Mission:
        """Mission, converted for the vehicle's autopilot by `start`."""
        return self._rendered.mission

    @property
    def done(self) -> bool:
        """Whether every plan was uploaded and verified."""
        return not self.failure and self._ending is None and self._transfer is None and not self._kinds

    @property
    def seconds_an_item(self) -> float:
        """Upload time per mission item (s); before the first upload, a default time."""
        times = [
            upload.duration_s / upload.items
            for upload in self.statistics
            if upload.mission_type is MissionType.MISSION and upload.items
        ]
        return times[-1] if times else _AN_ITEM_S

    def start(self, now_s: float) -> list[Message]:
        """Convert the plans for the autopilot and start the first upload; return the messages to send.

        If the autopilot would refuse a plan, nothing is sent and `failure` is set.
        """
        contact = self._contact
        self._rendered = render(self._rendered.mission, contact.profile, contact.monitor.vehicle_type)
        try:
            if not self._force:
                # Planning or preflight checks report the errors that depend on the vehicle's parameters.
                refuse_errors(self._rendered, arming=False)
        except LocalTransferError as error:
            self._kinds.clear()
            self.failure = str(error)
            return []
        state = contact.monitor.state
        # A simulated vehicle that reports no mission has none; a real vehicle may still hold a mission.
        holds = state.total > 0 if state.total is not None else contact.round_trip is not None
        holds &= contact.clears
        if holds and gives_up_mission(self.mission, self._kinds, contact.profile, armed=state.armed):
            self._clears = True
            self._transfer = contact.upload((), MissionType.MISSION, round_trip=contact.round_trip)
            return self._take(self._transfer.start(now_s), now_s)
        return self._next(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle a message of the mission protocol."""
        if self._transfer is None:
            return []
        return self._take(self._transfer.receive(message, now_s), now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Return the messages of the uploads that are due."""
        if self._ending is not None and now_s >= self._ending[1]:
            self.failure, self._ending = self._ending[0], None
        if self._transfer is None or now_s < self.next_deadline():
            return []
        return self._take(self._transfer.poll(now_s), now_s)

    def next_deadline(self) -> float:
        """Return the time of the next timeout in the uploads; infinity if there is none."""
        if self._ending is not None:
            return self._ending[1]
        deadline_s = None if self._transfer is None else self._transfer.next_deadline()
        return math.inf if deadline_s is None else deadline_s

    def _next(self, now_s: float) -> list[Message]:
        kind = self._kinds.popleft()
        self._transfer = self._contact.upload(
            self.mission.plan(kind),
            kind,
            home=self.mission.home,
            origins=self._rendered.origins_of(kind),
            round_trip=self._contact.round_trip,
        )
        return self._take(self._transfer.start(now_s), now_s)

    def _take(self, output: Output, now_s: float) -> list[Message]:
        out = list(output.messages)
        for event in output.events:
            if isinstance(event, Progress) and self._on_progress is not None:
                self._on_progress(event.done, event.total)
            elif isinstance(event, UploadVerified):
                self._end_transfer(now_s)
                if self._kinds:
                    out += self._next(now_s)
            elif isinstance(event, TransferFailed):
                self._end_transfer(now_s)
                # The vehicle's STATUSTEXT about the failure may arrive after the MISSION_ACK.
                self._kinds.clear()
                text = event.text + f"; {NO_MISSION_LEFT}" * (self._clears and len(self.statistics) > 1)
                self._ending = (text, now_s + _LAST_WORDS_S)
                self.fell_silent = event.reason is FailureReason.TIMEOUT
        return out

    def _end_transfer(self, now_s: float) -> None:
        if self._transfer is not None:
            self.statistics.append(self._transfer.statistics(now_s))
            self._transfer = None
