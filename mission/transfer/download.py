"""Download of a plan on the ground station's side, sans-IO."""

# ruff: noqa: ARG002 - the actions of the transition table share one signature

from __future__ import annotations

from typing import Any

from mission.errors import MissionError
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import is_a
from mission.model import MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.client import LISTING, ClientInput, ClientTransfer
from mission.transfer.events import DownloadComplete, FailureReason, LocalTransferError, Output, Progress
from mission.transfer.wire import from_wire_order

_I = ClientInput


class MissionDownload(ClientTransfer):
    """Download of a plan; ends with `DownloadComplete` or `TransferFailed`.

    Parameters
    ----------
    window : int, optional
        Maximum number of pending item requests. More than 1 works only with vehicles that answer requests in
        any order (ArduPilot). Default: 10 for such profiles, otherwise 1.
    **options
        See `mission.transfer.client.ClientTransfer`.

    Examples
    --------
    >>> download = MissionDownload(MissionType.FENCE)
    >>> download.start(now_s=0.0).messages[0].get_type()
    'MISSION_REQUEST_LIST'
    """

    _opening_input = _I.START_DOWNLOAD

    def __init__(
        self, mission_type: MissionType = MissionType.MISSION, *, window: int | None = None, **options: Any
    ) -> None:
        super().__init__(mission_type, **options)
        self.window = window if window is not None else 10 if self.profile.stateless_download else 1
        if self.window < 1:
            raise LocalTransferError(f"window {self.window}: give 1 or more pending requests")
        self._items: list[MissionItem | None] = []
        self._missing = 0
        self._most = 0
        self._asked: dict[int, tuple[float, int]] = {}
        self._next = 0
        self._restarts = 0
        self._opaque_id = 0
        self._received: tuple[int, MissionItem] | None = None
        self._broken = ""

    def _item_count(self) -> int:
        return len(self._items)

    def _opening(self) -> Message:
        return mavlink.MAVLink_mission_request_list_message(*self.target, self.mission_type)

    def _input_of(self, message: Message, now_s: float) -> ClientInput:
        if is_a(message, mavlink.MAVLink_mission_ack_message):
            return self._input_of_ack(message, accepted=False)
        if self._state is LISTING:
            if not is_a(message, mavlink.MAVLink_mission_count_message):
                return _I.STRAY
            return _I.COUNT if message.count else _I.COUNT_EMPTY
        if not wire.is_item(message):
            return _I.STRAY
        if message.seq >= len(self._items) or self._items[message.seq] is not None:
            return _I.STRAY
        try:
            self._received = (message.seq, wire.item_from_message(message))
        except MissionError as error:
            home = self.profile.home_at_zero and self.mission_type is MissionType.MISSION
            self._broken = f"item {message.seq if home else message.seq + 1} of the vehicle: {error}"
            return _I.ITEM_BROKEN
        return _I.ITEM_LAST if self._missing == 1 else _I.ITEM

    def _ask_first(self, message: wire.CountMessage, now_s: float) -> Output:
        self._measure_opening(now_s)
        if not self._restarts:
            self._progress_s = now_s
        self._items = [None] * message.count
        self._missing = message.count
        self._opaque_id = message.opaque_id
        self._asked, self._next, self._trouble = {}, 0, None
        return self._ask_more(now_s)

    def _ask_more(self, now_s: float) -> Output:
        messages = []
        while self._next < len(self._items) and len(self._asked) < self.window:
            messages.append(self._ask(self._next, now_s, 1))
            self._next += 1
        return Output(tuple(messages))

    def _ask(self, sequence: int, now_s: float, times: int) -> Message:
        self._asked[sequence] = (now_s, times)
        return mavlink.MAVLink_mission_request_int_message(*self.target, sequence, self.mission_type)

    def _store(self, now_s: float) -> Progress:
        assert self._received is not None
        sequence, item = self._received
        asked_s, times = self._asked.pop(sequence, (now_s, 0))
        if times == 1:
            self.round_trip.sample(now_s - asked_s)
        self._items[sequence] = item
        self._missing -= 1
        self._trouble = None
        self._progress_s = now_s
        done = len(self._items) - self._missing
        self._most = max(self._most, done)
        return Progress(self.mission_type, done, len(self._items))

    def _take_item(self, message: wire.ItemMessage, now_s: float) -> Output:
        progress = self._store(now_s)
        return Output(self._ask_more(now_s).messages, (progress,))

    def _complete(self, message: wire.CountMessage | wire.ItemMessage, now_s: float) -> Output:
        events: tuple[Progress, ...] = ()
        if is_a(message, mavlink.MAVLink_mission_count_message):
            self._items, self._opaque_id = [], message.opaque_id
        else:
            events = (self._store(now_s),)
        came = tuple(item for item in self._items if item is not None)
        items, home = from_wire_order(came, self.mission_type, self.profile)
        complete = DownloadComplete(self.mission_type, items, self._opaque_id, home)
        return Output((wire.ack(self.target, wire.ACCEPTED, self.mission_type),), (*events, complete))

    def _again_s(self, asked_s: float, times: int) -> float:
        """Return the time at which to request an item again that was requested ``times`` times."""
        copies, apart_s = self.round_trip.copies(self.profile.abort_s)
        if times % copies != 0:
            return asked_s + apart_s
        timers = self.timers
        wait_s = self.round_trip.wait(timers.item_s, timers.floor_s, timers.reply_s)
        return asked_s + max(wait_s - (copies - 1) * apart_s, apart_s)

    def _retry_s(self) -> float:
        if self._state is LISTING:
            return super()._retry_s()
        return min(self._again_s(*asked) for asked in self._asked.values())

    def _retry_input(self) -> ClientInput:
        if self._state is LISTING:
            return _I.RETRY
        if self._restarts >= self.timers.retries:
            return _I.RETRY
        copies, _ = self.round_trip.copies(self.profile.abort_s)
        vain = any(times > 2 * self.timers.retries * copies for _, times in self._asked.values())
        return _I.RESTART if vain or self._trouble is not None else _I.RETRY

    def _ask_again(self, message: None, now_s: float) -> Output:
        late = [
            (number, times)
            for number, (asked_s, times) in self._asked.items()
            if now_s >= self._again_s(asked_s, times)
        ]
        self._retries += len(late)
        return Output(tuple(self._ask(sequence, now_s, times + 1) for sequence, times in late))

    def _restart(self, message: None, now_s: float) -> Output:
        """Restart the download with a new LIST, because the vehicle seems to have ended the transfer."""
        self._restarts += 1
        self._asked, self._openings = {}, 0
        return self._repeat_opening(None, now_s)

    def _give_up_s(self) -> float:
        limit_s = self._progress_s + self._silence_s()
        return min(limit_s, self._opening_limit_s()) if self._state is LISTING else limit_s

    def _fail_broken(self, message: wire.ItemMessage, now_s: float) -> Output:
        return self._failed(FailureReason.BROKEN, self._broken, None, notify=True)

    def _where(self) -> str:
        return f"after {self._most} of {len(self._items)} items" if self._items else "at the start"
