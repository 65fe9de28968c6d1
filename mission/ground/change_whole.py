"""Change of a mission in flight on autopilots that replace missions atomically (PX4)."""

from __future__ import annotations

import math

from mission.ground.change import ChangeOutcome, ChangeRequest, ChangeSession
from mission.ground.items import apart_m, item_to_mark, leads_on, next_flown_to, same_position
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import MissionType
from mission.transfer import (
    CLIENT_MESSAGES,
    DownloadComplete,
    FailureReason,
    Output,
    PlanState,
    TransferFailed,
    UploadVerified,
    VerifiedUpload,
    compare_plans,
)

_SHOWN_S = 1.5
_MARKS = 4
_AGAIN_S = 2.0
_SURELY = 0.9
_SLOWEST_M_S = 1.0


class WholeListChange(ChangeSession):
    """Change by an upload with the next item marked as current; the vehicle stays in mission mode.

    The vehicle flies the old mission until the last new item arrives, then the new mission. The plan id in
    MISSION_ACK and MISSION_CURRENT shows which mission the vehicle flies. The new mission is read back in
    flight. If the last ACK is lost, the mission is downloaded to find out which mission the vehicle holds.
    """

    def __init__(self, request: ChangeRequest) -> None:
        super().__init__(request)
        self._passed, self._mark = request.item, 0
        self._target = request.resume_at
        self._upload_sent: VerifiedUpload | None = None
        self._verified = False
        self._due_s = math.inf
        self._marks = 0
        self._why = ""
        self._id = 0

    _flown_meanwhile = "the vehicle flies the old path"

    def _item_now(self) -> int:
        """Return the item to mark as current in an upload that starts now."""
        self._target = self._next_then()
        self._mark = item_to_mark(self.request.old, self._passed, self.request.new, self._target)
        return self._mark

    def _next_then(self) -> int:
        """Return the item to fly to after the upload; items passed during the upload are skipped."""
        request = self.request
        old, new, state = request.old.items, request.new.items, self._monitor.state
        item, target = request.item, request.resume_at
        # Skip items that were passed during an earlier attempt.
        while item < (onward := next_flown_to(old, item)) <= self._passed:
            if not same_position(old[item], new[target]):
                break
            item, target = onward, next_flown_to(new, target)
        if not same_position(old[item], new[target]) or not math.isfinite(state.latitude_deg):
            return target
        # Half of the measured time per item is for the upload, the other half for reading the mission back.
        upload_s = _SURELY * 0.5 * request.seconds_an_item * (len(new) + 1)
        here, passed_s = (state.latitude_deg, state.longitude_deg), 0.0
        while True:
            there = (new[target].x, new[target].y)
            passed_s += apart_m(here, there) / max(state.ground_speed_m_s, _SLOWEST_M_S)
            following = next_flown_to(new, target)
            if passed_s > upload_s or following == target:
                return target
            here, target, item = there, following, next_flown_to(old, item)
            if not same_position(old[item], new[target]):
                return target

    def start(self, now_s: float) -> list[Message]:
        """Start the upload."""
        self.record.asked_s = self.record.sent_s = now_s
        self._transfer = self._upload_sent = self._upload(self.request.new.items, self._item_now)
        return self._take(self._transfer.start(now_s), now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle a message of the mission protocol."""
        if self.done:
            return []
        out: list[Message] = []
        if self._transfer is not None and type(message).id in CLIENT_MESSAGES:
            out = self._take(self._transfer.receive(message, now_s), now_s)
        if isinstance(message, m.MAVLink_mission_current_message):
            item = self._monitor.state.item
            if self.record.acknowledged_s is None and item is not None:
                # A passed item of the old mission may have switched the camera off.
                self._passed = max(self._passed, min(item, len(self.request.old.items) - 1))
            self._look(now_s)
        return out

    def poll(self, now_s: float) -> list[Message]:
        """Handle the timers that are due."""
        if self.done:
            return []
        out = self._poll_transfer(now_s)
        if now_s >= self._due_s:
            out += self._insist(now_s) if self._verified else self._read(now_s)
        return out

    def next_deadline(self) -> float:
        """Return the time of the next timeout in the change; infinity if there is none."""
        return math.inf if self.done else min(self._due_s, self._transfer_s)

    def _take(self, output: Output, now_s: float) -> list[Message]:
        out = list(output.messages)
        sent = self._upload_sent
        if sent is not None and self.record.acknowledged_s is None:
            self.record.acknowledged_s = sent.confirmed_s
        for event in output.events:
            self._note_begun_anew(event, now_s)
            if isinstance(event, UploadVerified):
                self._finish_transfer(now_s)
                self._verified = True
                self._due_s = now_s + _SHOWN_S
                self._look(now_s)
            elif isinstance(event, DownloadComplete):
                self._finish_transfer(now_s)
                self._compare(event, now_s)
            elif isinstance(event, TransferFailed):
                reading = self._transfer is not sent
                self._finish_transfer(now_s)
                if not reading:
                    self._why = self._said(event.text)
                if reading or event.vehicle_plan is not PlanState.OLD:
                    self._due_s = now_s + _AGAIN_S
                elif event.reason is FailureReason.REFUSED:
                    self._end(ChangeOutcome.REFUSED, self._why, now_s)
                else:
                    self._end(ChangeOutcome.GIVEN_UP, self._why, now_s)
        return out

    def _finish_transfer(self, now_s: float) -> None:
        if self._transfer is not None:
            self.record.retries += self._transfer.statistics(now_s).retries
            if self._upload_sent is not None and self._transfer is self._upload_sent:
                self._id = self._upload_sent.opaque_id
            self._transfer = None

    def _read(self, now_s: float) -> list[Message]:
        """Download the mission to find out which mission the vehicle holds."""
        self._due_s = math.inf
        self._transfer = self._contact.download(MissionType.MISSION, round_trip=self._round_trip)
        return self._take(self._transfer.start(now_s), now_s)

    def _compare(self, read: DownloadComplete, now_s: float) -> None:
        request = self.request
        if not compare_plans(request.new.items, read.items, self._contact.profile):
            if self.record.acknowledged_s is None:
                self.record.acknowledged_s = now_s
            self._verified, self._id = True, read.opaque_id
            self._due_s = now_s + _SHOWN_S
            self._look(now_s)
        elif not compare_plans(request.old.items, read.items, self._contact.profile):
            self._end(ChangeOutcome.GIVEN_UP, self._why, now_s)
        else:
            self._end(ChangeOutcome.GIVEN_UP, f"{self._why}; the vehicle holds another mission", now_s)

    def _look(self, now_s: float) -> None:
        """End the change if telemetry proves that the vehicle flies the new mission."""
        state = self._monitor.state
        sent = self._upload_sent
        known_id = self._id if sent is None or self._transfer is not sent else sent.opaque_id
        confirmed_s = self.record.acknowledged_s
        if self.record.in_effect_s is None and confirmed_s is not None:
            heard = self._monitor.item_heard_s >= confirmed_s
            same = known_id in (0, state.mission_id)
            flies = not self._monitor.left_mission or self._returns_as_wanted()
            # An item number beyond the new mission is from a delayed message about the old mission.
            known = state.item is not None and self._mark <= state.item < len(self.request.new.items)
            if heard and same and flies and known:
                self.record.in_effect_s, self.record.turned_s = now_s, confirmed_s
        if self._verified and self.record.in_effect_s is not None:
            self._end(ChangeOutcome.DONE, "", now_s)

    def _returns_as_wanted(self) -> bool:
        """Whether only the return remains to be flown, and the vehicle is in the mode of the return (PX4)."""
        items = self.request.new.items
        if leads_on(items, self._target):
            return False
        return self._monitor.mode in self._monitor.modes.ends(int(items[-1].command))

    def _insist(self, now_s: float) -> list[Message]:
        """Order the vehicle to the item at which to resume, if the vehicle reports another item."""
        monitor = self._monitor
        self._due_s = now_s + _SHOWN_S
        state = monitor.state
        fresh = monitor.item_heard_s > now_s - _SHOWN_S and self._id in (0, state.mission_id)
        # The progress of a silent vehicle is unknown.
        if not fresh or state.item is None:
            return []
        if monitor.left_mission:
            self.held = self.request.new
            # At the end of a mission, PX4 stays in mission mode until the vehicle returns.
            ended = "had flown its mission to the end" if monitor.in_mission else "had left its mission"
            self._end(ChangeOutcome.GIVEN_UP, f"the vehicle {ended} ({monitor.mode})", now_s)
            return []
        self._marks += 1
        if self._marks > _MARKS:
            self.held = self.request.new
            self._end(ChangeOutcome.GIVEN_UP, f"the vehicle stays at item {state.item + 1}", now_s)
            return []
        request = self.request
        self._mark = item_to_mark(request.old, self._passed, request.new, self._target)
        home = 1 if self._contact.profile.home_at_zero else 0
        return [m.MAVLink_mission_set_current_message(*self._contact.vehicle, self._mark + home)]
