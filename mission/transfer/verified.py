"""Verified upload (upload, read back, compare), sans-IO.

The last ACK of an upload can be lost, and then the client cannot know whether the vehicle has the new plan
(the two generals' problem). Reading the plan back resolves the uncertainty. The outcomes are:

- `UploadVerified`: the vehicle holds the plan that was sent.
- `TransferFailed` with ``vehicle_plan`` OLD: the vehicle refused the plan or never received all items, and
  keeps the old plan.
- `TransferFailed` with reason REFUSED and ``vehicle_plan`` UNKNOWN: a vehicle that overwrites its plan in
  place (ArduPilot) refused an item; the text names the items that the vehicle holds.
- `TransferFailed` with reason DIFFERENT: the plan read back differs from the plan that was sent.
- `TransferFailed` with ``vehicle_plan`` UNKNOWN: the vehicle stopped answering after the last item or while
  the plan was read back; or, if it overwrites its plan in place, at any time after the first message, which
  may truncate the old plan.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from mission.autopilots import GENERIC
from mission.autopilots.profile import Profile
from mission.link.codec.dialect import Message
from mission.model import Command, GeoPoint, MissionItem, MissionType, plan_of
from mission.transfer import wire
from mission.transfer.download import MissionDownload
from mission.transfer.events import (
    NOTHING,
    ClearComplete,
    DownloadComplete,
    Event,
    FailureReason,
    LocalTransferError,
    Output,
    PlanState,
    Progress,
    Transfer,
    TransferFailed,
    TransferStatistics,
    UploadBegunAnew,
    UploadComplete,
    UploadVerified,
)
from mission.transfer.round_trip import RoundTrip
from mission.transfer.upload import START_S, MissionUpload

_PLACE_DEG = 2.5e-7
_ALTITUDE_M = 0.011
_RELATIVE = 1e-5
_YAW_DEG = 1e-2
_WITH_YAW = frozenset({Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM, Command.NAV_LAND, Command.NAV_TAKEOFF})
_FIELDS = ("command", "frame", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that differs between the sent plan and the plan read back.

    Parameters
    ----------
    sequence : int
        Item number, from 0 (users count from 1); -1 for the plan as a whole.
    field : str
        ``count``, or a field of `MissionItem`.
    sent, received : float or None
        Sent value and value read back.
    """

    sequence: int
    field: str
    sent: float | None
    received: float | None

    def __str__(self) -> str:
        if self.sequence < 0:
            return f"{self.sent:g} items were sent, the vehicle holds {self.received:g}"
        sent = f"item {self.sequence + 1}: {self.field} was sent as {self.sent}"
        return f"{sent}, the vehicle holds {self.received}"


def _equal(name: str, item: MissionItem, held: MissionItem, profile: Profile) -> bool:
    sent: float | None = getattr(item, name)
    received: float | None = getattr(held, name)
    if name == "frame" and not profile.keeps_frame and not item.has_position:
        return True
    if name == "autocontinue" and plan_of(item.command) not in profile.keeps_autocontinue:
        return True
    known = profile.read_back.get(item.command, {}).get(name)
    if known is not None and received is not None and known.of(sent) == received:
        return True
    if sent is None or received is None:
        return sent is received or (sent is None and received == 0.0 and not profile.keeps_default)
    difference = abs(float(sent) - float(received))
    if name in ("command", "frame", "autocontinue"):
        return difference == 0.0
    if item.has_position and name in ("x", "y"):
        return difference <= _PLACE_DEG
    if item.has_position and name == "z":
        return difference <= max(_ALTITUDE_M, _RELATIVE * abs(sent))
    if difference <= _RELATIVE * max(1.0, abs(sent)):
        return True
    if name in ("x", "y"):
        return int(sent) == int(received)
    if item.command == Command.NAV_WAYPOINT and name == "param1" and profile.whole_seconds:
        return difference < 1.0
    if item.command in _WITH_YAW and name == "param4":
        return abs(math.remainder(difference, 360.0)) <= _YAW_DEG
    return False


def compare_plans(
    sent: tuple[MissionItem, ...],
    received: tuple[MissionItem, ...],
    profile: Profile = GENERIC,
    *,
    limit: int = 20,
) -> tuple[Difference, ...]:
    """Return the differences between a sent plan and the plan read back, at most ``limit``.

    Changes by the wire format and by the autopilot's storage are not differences: rounding to 32-bit floats
    (1e-5 relative), 2.5e-7 degrees, 1.1 cm of altitude, full turns of yaw, the frames 5/6/11 in place of
    0/3/10 (which `MissionItem` treats as equal), and fields that the profile marks as not stored or rounded.
    """
    if len(sent) != len(received):
        return (Difference(-1, "count", len(sent), len(received)),)
    found: list[Difference] = []
    for sequence, (item, held) in enumerate(zip(sent, received, strict=True)):
        if item != held:
            found += [
                Difference(sequence, name, getattr(item, name), getattr(held, name))
                for name in _FIELDS
                if name not in profile.lossy.get(item.command, ()) and not _equal(name, item, held, profile)
            ]
        if len(found) >= limit:
            break
    return tuple(found[:limit])


_RESTARTS = 5
_STUCK_S, _QUICK_S = 15.0, 1.0
# After it aborted an upload, PX4 answers items with ERROR, and ArduPilot sends OPERATION_CANCELLED.
_GIVEN_UP = frozenset({wire.ERROR, wire.OPERATION_CANCELLED})


class VerifiedUpload:
    """Upload of a plan, followed by a download and a comparison; implements `Transfer`.

    An upload aborted by the vehicle is retried up to five times, with the event `UploadBegunAnew`. A timeout
    over a link with heavy frame loss (`RoundTrip.copies`) is retried too. Retries end if the vehicle accepts
    no item within 30 s, if the vehicle refuses the same item twice without repetitions on the link, or if
    retries over a good link make no progress for 15 s.

    Parameters
    ----------
    start_sequence : int, None, or callable
        Item to mark as current, or None for none. A callable is called for each attempt.
    readings : int
        Number of downloads that must show a difference; an echo of an older transfer can spoil a download.
    send, read : callable
        Factories of the transfers, with the parameters of `MissionUpload` and `MissionDownload`.
    **options
        See `MissionUpload`, also for the other parameters.

    Attributes
    ----------
    differences : tuple of Difference
        Differences found in the last download.
    confirmed_s : float or None
        Time at which the vehicle acknowledged the plan.
    opaque_id : int
        Plan id from the vehicle's acknowledgement, 0 for none.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        mission_type: MissionType = MissionType.MISSION,
        *,
        home: GeoPoint | None = None,
        start_sequence: int | Callable[[], int | None] | None = 0,
        origins: Sequence[int] | None = None,
        readings: int = 2,
        send: Callable[..., Transfer] = MissionUpload,
        read: Callable[..., Transfer] = MissionDownload,
        **options: Any,
    ) -> None:
        self.mission_type, self.items = mission_type, tuple(items)
        self.differences: tuple[Difference, ...] = ()
        self.confirmed_s: float | None = None
        self.opaque_id = 0
        self._profile: Profile = options.get("profile", GENERIC)
        self._round_trip: RoundTrip = options.get("round_trip") or RoundTrip()
        options["round_trip"] = self._round_trip
        self._marked = start_sequence if callable(start_sequence) else lambda: start_sequence
        self._make = partial(send, self.items, mission_type, home=home, origins=origins, **options)
        self._read = partial(read, mission_type, **options)
        self._part = self._upload = self._send()
        self._parts = [self._upload]
        self._readings = readings
        self._restarts = _RESTARTS
        self._started_s = 0.0
        self._sent = 0
        # Largest number of items accepted in any attempt, and the time at which it was reached.
        self._most, self._most_s = 0, 0.0
        self._refused_at: tuple[int | None] | None = None
        self._cancelled = self._verified = False
        self._refusal: TransferFailed | None = None
        self._origins = range(len(self.items)) if origins is None else origins

    @property
    def done(self) -> bool:
        """Whether the transfer has ended, successfully or not."""
        return self._part.done

    def start(self, now_s: float) -> Output:
        """Start the upload."""
        self._started_s = self._most_s = now_s
        return self._part.start(now_s)

    def receive(self, message: Message, now_s: float) -> Output:
        """Handle one message."""
        return self._continue(self._part.receive(message, now_s), now_s)

    def poll(self, now_s: float) -> Output:
        """Handle the timers that are due."""
        return self._continue(self._part.poll(now_s), now_s)

    def next_deadline(self) -> float | None:
        """Return the time of the next `poll` that has an effect; None before the start and after the end."""
        return self._part.next_deadline()

    def cancel(self, now_s: float) -> Output:
        """Cancel the transfer and notify the vehicle; raise LocalTransferError if the transfer has ended."""
        if self.done:
            raise LocalTransferError("this upload is over; there is nothing to cancel")
        self._cancelled = True
        return self._continue(self._part.cancel(now_s), now_s)

    def statistics(self, now_s: float | None = None) -> TransferStatistics:
        """Return the statistics of all uploads and downloads together."""
        parts = [part.statistics(now_s) for part in self._parts]
        return TransferStatistics(
            self.mission_type,
            len(self.items),
            sum(part.messages_sent for part in parts),
            sum(part.messages_received for part in parts),
            sum(part.retries for part in parts) + _RESTARTS - self._restarts,
            sum(part.duration_s for part in parts),
            self._verified,
        )

    def _continue(self, output: Output, now_s: float) -> Output:
        """If an upload or download has ended, begin the next step, whose output replaces the last event."""
        for event in output.events:
            if isinstance(event, Progress) and self._part is self._upload:
                self._sent = event.done
                if event.done > self._most:
                    self._most, self._most_s = event.done, now_s
        if not self._part.done or not output.events:
            return output
        *events, end = output.events
        following = self._after(end, now_s)
        return Output(output.messages, tuple(events)) + following

    def _after(self, end: Event, now_s: float) -> Output:
        if isinstance(end, UploadComplete | ClearComplete):
            self.confirmed_s = now_s
            if isinstance(end, UploadComplete):
                self.opaque_id = end.opaque_id
            return self._read_back(now_s)
        if isinstance(end, DownloadComplete):
            return self._compare(end, now_s)
        if isinstance(end, TransferFailed):
            return self._after_failure(end, now_s)
        return NOTHING

    def _after_failure(self, failed: TransferFailed, now_s: float) -> Output:
        if self._part is self._upload:
            if self._is_given_up(failed, now_s) or (self._is_bad_luck(failed) and self._under_way):
                return self._send_again(failed, now_s)
            # A vehicle that accepted no item before the timeout would not answer a download either.
            # Only `MissionUpload` reports the number of accepted items.
            counts = bool(self.items) and isinstance(self._upload, MissionUpload)
            can_read = self._under_way or failed.reason is not FailureReason.TIMEOUT or not counts
            if failed.vehicle_plan is PlanState.UNKNOWN and not self._cancelled and can_read:
                self._refusal = None if failed.reason is FailureReason.TIMEOUT else failed
                return self._read_back(now_s)
            return Output(events=(failed,))
        if self._is_bad_luck(failed):
            self._restarts -= 1
            return self._read_back(now_s)
        if self._refusal is not None:
            text = f"{self._refusal.text}; the plan that the vehicle holds now could not be read"
            return Output(events=(replace(self._refusal, text=text),))
        text = f"the {self.mission_type.name.lower()} was sent but not verified: {failed.text}"
        return Output(events=(replace(failed, text=text, vehicle_plan=PlanState.UNKNOWN),))

    def _is_bad_luck(self, failed: TransferFailed) -> bool:
        """Return whether frame loss alone may explain the failure, so that a retry makes sense."""
        copies, _ = self._round_trip.copies(self._profile.abort_s)
        gave_up = failed.reason is FailureReason.TIMEOUT or failed.result in _GIVEN_UP
        return copies > 1 and gave_up and self._restarts > 0

    @property
    def _under_way(self) -> bool:
        """Whether the vehicle requested a second item of this upload, or all items were sent."""
        return self._sent > 1 or self._sent == len(self.items) > 0

    def _is_given_up(self, failed: TransferFailed, now_s: float) -> bool:
        """Whether the vehicle aborted the upload and a retry makes sense.

        PX4 sends the same result for an invalid item. The item counts as invalid if PX4 refuses it twice in
        uploads without repeated messages.
        """
        # A vehicle sends ERROR before the first item if it is busy.
        gave_up = failed.result == wire.OPERATION_CANCELLED or (failed.result == wire.ERROR and self._sent)
        trip = self._round_trip
        is_good = not trip.is_lossy and (trip.known_s or 0.0) <= _QUICK_S
        is_stuck = is_good and now_s >= self._most_s + _STUCK_S
        if not gave_up or self._restarts <= 0 or is_stuck:
            return False
        before = self._refused_at
        self._refused_at = None if self._upload.statistics().retries else (failed.item,)
        begins = self._under_way or now_s < self._started_s + START_S
        return begins and (before is None or before != self._refused_at)

    def _send(self, begun_s: float | None = None) -> Transfer:
        """Return a new upload; ``begun_s`` is the start time of the first attempt."""
        further = {} if begun_s is None else {"begun_s": begun_s}
        return self._make(start_sequence=self._marked(), **further)

    def _send_again(self, failed: TransferFailed, now_s: float) -> Output:
        self._restarts -= 1
        # The limit of 30 s restarts once the vehicle has accepted an item.
        self._started_s = now_s if self._under_way else self._started_s
        self._sent = 0
        self._part = self._upload = self._send(self._started_s)
        self._parts.append(self._upload)
        anew = UploadBegunAnew(self.mission_type, failed.text)
        return Output(events=(anew,)) + self._upload.start(now_s)

    def _read_back(self, now_s: float) -> Output:
        self._part = self._read()
        self._parts.append(self._part)
        return self._part.start(now_s)

    def _compare(self, received: DownloadComplete, now_s: float) -> Output:
        found = compare_plans(self.items, received.items, self._profile)
        self.differences = tuple(
            difference
            if difference.sequence < 0
            else replace(difference, sequence=self._origins[difference.sequence])
            for difference in found
        )
        if not self.differences:
            self._verified = True
            return Output(events=(UploadVerified(self.mission_type, len(self.items)),))
        self._readings -= 1
        if self._readings > 0:
            return self._read_back(now_s)
        if self._refusal is not None:
            if self._profile.atomic:
                return Output(events=(replace(self._refusal, vehicle_plan=PlanState.OLD),))
            return self._refused(self._refusal, received)
        text = f"the vehicle does not hold the {self.mission_type.name.lower()} that was sent: "
        text += str(self.differences[0])
        if len(self.differences) > 1:
            text += f" (and {len(self.differences) - 1} more)"
        unknown = self.confirmed_s is not None or not self._profile.atomic
        state = PlanState.UNKNOWN if unknown else PlanState.OLD
        failed = TransferFailed(self.mission_type, FailureReason.DIFFERENT, text, None, state)
        return Output(events=(failed,))

    def _refused(self, refusal: TransferFailed, received: DownloadComplete) -> Output:
        """Fail with the vehicle's refusal; the text names the plan that the vehicle holds now."""
        text = f"{refusal.text}; {_held_text(self.items, received.items, self._profile)}"
        return Output(events=(replace(refusal, text=text),))


def _held_text(sent: Sequence[MissionItem], held: Sequence[MissionItem], profile: Profile) -> str:
    """Return a text about the plan that a vehicle holds after a refusal, if it overwrites items in place."""
    new = 0
    for sent_item, held_item in zip(sent, held, strict=False):
        if compare_plans((sent_item,), (held_item,), profile):
            break
        new += 1
    if not held:
        return "the vehicle now holds no items"
    part = "none" if not new else "all" if new == len(held) else f"the first {new}"
    return f"the vehicle now holds {len(held)} items, {part} as sent: upload again before flying"


class TransferMaker(NamedTuple):
    """Factories of verified uploads and of downloads.

    They take the parameters of `VerifiedUpload` and `MissionDownload`; unsupported options are ignored.
    """

    upload: Callable[..., VerifiedUpload]
    download: Callable[..., Transfer]


OWN_TRANSFERS = TransferMaker(VerifiedUpload, MissionDownload)
"""Default factory: the state machines of this package."""
