"""Plans up and down by MAVSDK's plugin mission_raw, with the face of our own transfers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError, MissionRawResult

from mission.autopilots import GENERIC
from mission.autopilots.profile import Profile
from mission.errors import MissionError
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import (
    DownloadComplete,
    FailureReason,
    LocalTransferError,
    MissionUpload,
    Output,
    PlanState,
    Progress,
    TransferFailed,
    TransferStatistics,
    UploadVerified,
    compare_plans,
    wire,
)
from mission.transfer.events import NOTHING, Event
from mission.transfer.verified import different_plan, told_of_held
from mission.transfer.wire import from_wire_order
from wbf_mission.live.via_mavsdk.link import Call, MavsdkLink

__all__ = ["MavsdkTransfers"]

_UPLOADS = {
    MissionType.MISSION: "upload_mission_async",
    MissionType.FENCE: "upload_geofence_async",
    MissionType.RALLY: "upload_rally_points_async",
}
_DOWNLOADS = {
    MissionType.MISSION: "download_mission_async",
    MissionType.FENCE: "download_geofence_async",
    MissionType.RALLY: "download_rallypoints_async",
}
_ITEM_FIELDS = (
    "seq", "frame", "command", "current", "autocontinue",
    "param1", "param2", "param3", "param4", "x", "y", "z", "mission_type",
)  # fmt: skip
_REASONS = {
    MissionRawResult.TIMEOUT: FailureReason.TIMEOUT,
    MissionRawResult.NO_SYSTEM: FailureReason.TIMEOUT,
    MissionRawResult.TRANSFER_CANCELLED: FailureReason.CANCELLED,
}
_POLL_S = 0.02
# MAVSDK gives up by itself; this is for a call that it never answers.
_LONGEST_S = 300.0


class MavsdkTransfers:
    """Makes transfers that MAVSDK carries out over the link that it keeps when one begins."""

    def __init__(self, link: Callable[[], MavsdkLink]) -> None:
        self._link = link

    def upload(
        self,
        items: Sequence[MissionItem],
        mission_type: MissionType,
        *,
        home: GeoPoint | None = None,
        start_sequence: int | None = 0,
        origins: Sequence[int] | None = None,
        target: tuple[int, int] = (1, 1),
        profile: Profile = GENERIC,
        **_options: Any,
    ) -> MavsdkUpload:
        """Return an upload that is read back; see `mission.transfer.uploader.TransferMaker`."""
        if not items and mission_type is not MissionType.MISSION:
            msg = f"MAVSDK cannot empty a vehicle's {mission_type.name.lower()} plan; leave out --via mavsdk"
            raise LocalTransferError(msg)
        plan = MissionUpload(
            items,
            mission_type,
            home=home,
            start_sequence=start_sequence or 0,
            origins=origins,
            target=target,
            profile=profile,
        )
        return MavsdkUpload(plan, self.download(mission_type, target=target, profile=profile), self._link)

    def download(
        self,
        mission_type: MissionType,
        *,
        target: tuple[int, int] = (1, 1),
        profile: Profile = GENERIC,
        **_options: Any,
    ) -> MavsdkDownload:
        """Return a reading of a plan."""
        return MavsdkDownload(mission_type, target, profile, self._link)


class _Transfer:
    """What MAVSDK's uploads and downloads have in common: a call under way, and what the vehicle says.

    MAVSDK does not tell how many messages it sent: the statistics have 0 for that.
    """

    _verb: str
    _count = 0
    _verified = False

    def __init__(
        self,
        mission_type: MissionType,
        target: tuple[int, int],
        profile: Profile,
        link: Callable[[], MavsdkLink],
    ) -> None:
        self.mission_type = mission_type
        self.done = False
        self._target, self._profile = target, profile
        self._link = link
        self._call: Call | None = None
        self._first_s: float | None = None
        self._began_s = self._ended_s = self._due_s = 0.0

    @property
    def _raw(self) -> Any:
        return self._link().plugin(MissionRaw, self._target[0])

    @property
    def _what(self) -> str:
        return f"{self._verb} of the {self.mission_type.name.lower()}"

    def receive(self, message: Message, now_s: float) -> Output:  # noqa: ARG002
        """Take nothing: MAVSDK hears what matters."""
        return NOTHING

    def _begin(self, now_s: float, begin: Callable[..., None], *arguments: Any) -> None:
        self._began_s = now_s
        self._first_s = now_s if self._first_s is None else self._first_s
        self._due_s = now_s + _POLL_S
        self._call = Call(begin, *arguments)

    def _answer(self, now_s: float) -> tuple[Any, ...] | None:
        """Return MAVSDK's answer; None while there is none."""
        if self._call is None or now_s < self._due_s:
            return None
        self._due_s = now_s + _POLL_S
        answer = self._call.answer()
        if answer is None and now_s > self._began_s + _LONGEST_S:
            answer = (MissionRawResult.TIMEOUT, [])
        if answer is not None:
            self._call = None
        return answer

    def _finish(self, now_s: float, *events: Event) -> Output:
        self.done, self._call, self._ended_s = True, None, now_s
        return Output(events=events)

    def _failure(self, result: MissionRawResult, state: PlanState) -> TransferFailed:
        """Return the event of a failure, in MAVSDK's word."""
        reason = _REASONS.get(result, FailureReason.REFUSED)
        text = f"{self._what} failed: MAVSDK says {result.name}"
        if reason is FailureReason.TIMEOUT:
            text += "; the vehicle did not answer, check the link and try again"
        code = wire.UNSUPPORTED if result is MissionRawResult.UNSUPPORTED else None
        return TransferFailed(self.mission_type, reason, text, code, state)

    def next_deadline(self) -> float | None:
        """When `poll` has something to do, None before the start and after the end."""
        return None if self._call is None else self._due_s

    def cancel(self, now_s: float) -> Output:
        """Break off."""
        if self.mission_type is MissionType.MISSION and self._call is not None:
            with contextlib.suppress(MissionRawError):
                getattr(self._raw, f"cancel_mission_{self._verb}")()
        text = f"{self._what} was cancelled"
        return self._finish(now_s, TransferFailed(self.mission_type, FailureReason.CANCELLED, text))

    def statistics(self, now_s: float | None = None) -> TransferStatistics:
        """What it has cost, as far as MAVSDK tells."""
        end_s = self._ended_s if self.done or now_s is None else now_s
        spent_s = end_s - (self._first_s or 0.0)
        return TransferStatistics(self.mission_type, self._count, 0, 0, 0, spent_s, self._verified)


class MavsdkDownload(_Transfer):
    """Reads a plan; ends with `DownloadComplete` or `TransferFailed`."""

    _verb = "download"

    def start(self, now_s: float) -> Output:
        """Begin."""
        self._begin(now_s, getattr(self._raw, _DOWNLOADS[self.mission_type]))
        return NOTHING

    def poll(self, now_s: float) -> Output:
        """See whether MAVSDK has answered."""
        answer = self._answer(now_s)
        if answer is None:
            return NOTHING
        result, raw = answer
        if result not in (MissionRawResult.SUCCESS, MissionRawResult.NO_MISSION_AVAILABLE):
            return self._finish(now_s, self._failure(result, PlanState.OLD))
        try:
            came = tuple(_item_of(one) for one in raw)
        except MissionError as error:
            broken = TransferFailed(self.mission_type, FailureReason.BROKEN, f"{self._what}: {error}")
            return self._finish(now_s, broken)
        items, home = from_wire_order(came, self.mission_type, self._profile)
        self._count = len(items)
        progress = Progress(self.mission_type, len(came), len(came))
        return self._finish(now_s, progress, DownloadComplete(self.mission_type, items, 0, home))


class MavsdkUpload(_Transfer):
    """Sends a plan, reads it back and compares; ends with `UploadVerified` or `TransferFailed`.

    The plan is a `MissionUpload` that is never started. MAVSDK does not tell its id.
    """

    opaque_id = 0
    _verb = "upload"

    def __init__(self, plan: MissionUpload, reading: MavsdkDownload, link: Callable[[], MavsdkLink]) -> None:
        super().__init__(plan.mission_type, plan.target, plan.profile, link)
        self.confirmed_s: float | None = None
        self._plan = plan
        self._count = len(plan.items)
        self._reading = reading
        self._refused: TransferFailed | None = None

    def start(self, now_s: float) -> Output:
        """Begin the upload."""
        raw = [
            RawItem(*(getattr(message, field) for field in _ITEM_FIELDS))
            for message in self._plan.item_messages()
        ]
        if raw:
            self._begin(now_s, getattr(self._raw, _UPLOADS[self.mission_type]), raw)
        else:
            self._begin(now_s, self._raw.clear_mission_async)
        return NOTHING

    def poll(self, now_s: float) -> Output:
        """Go on when MAVSDK has answered."""
        if self.done:
            return NOTHING
        if self._call is None:
            return self._after_reading(self._reading.poll(now_s), now_s)
        answer = self._answer(now_s)
        if answer is None:
            return NOTHING
        result = answer[0]
        if result is MissionRawResult.SUCCESS:
            self.confirmed_s = now_s
        elif _REASONS.get(result) is not FailureReason.TIMEOUT:
            state = PlanState.OLD if self._profile.atomic else PlanState.UNKNOWN
            self._refused = self._failure(result, state)
            if self._profile.atomic:
                return self._finish(now_s, self._refused)
        # What a vehicle that overwrites in place holds after a refusal is to be told. After a timeout it may
        # hold the plan all the same: reading it tells.
        self._reading.start(now_s)
        return NOTHING

    def next_deadline(self) -> float | None:
        """When `poll` has something to do, None before the start and after the end."""
        return super().next_deadline() if self._call is not None else self._reading.next_deadline()

    def _after_reading(self, read: Output, now_s: float) -> Output:
        """Compare what was read with what was sent."""
        if not read.events:
            return NOTHING
        end = read.events[-1]
        if self._refused is not None:
            held = "what the vehicle holds now could not be read"
            if isinstance(end, DownloadComplete):
                held = told_of_held(self._plan.items, end.items, self._profile)
            return self._finish(now_s, replace(self._refused, text=f"{self._refused.text}; {held}"))
        if isinstance(end, TransferFailed):
            text = f"the {self.mission_type.name.lower()} was sent but not verified: {end.text}"
            return self._finish(now_s, replace(end, text=text, vehicle_plan=PlanState.UNKNOWN))
        assert isinstance(end, DownloadComplete)
        items = self._plan.items
        differences = compare_plans(items, end.items, self._profile)
        if not differences:
            self._verified = True
            if self.confirmed_s is None:
                self.confirmed_s = now_s
            progress = Progress(self.mission_type, len(items), len(items))
            return self._finish(now_s, progress, UploadVerified(self.mission_type, len(items)))
        if self.confirmed_s is None:
            return self._finish(now_s, self._failure(MissionRawResult.TIMEOUT, PlanState.UNKNOWN))
        different = different_plan(self.mission_type, differences, PlanState.UNKNOWN)
        return self._finish(now_s, different)


def _item_of(raw: RawItem) -> MissionItem:
    """Return an item that MAVSDK read; MissionError for infinite numbers, or a position that is none."""
    fields = [getattr(raw, field) for field in _ITEM_FIELDS]
    return wire.item_from_message(m.MAVLink_mission_item_int_message(0, 0, *fields))
