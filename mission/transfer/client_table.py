"""The ground station's side of the mission protocol as one table.

Each row reads: in this state, on this input, do this and go there. An input is a message already judged
against the state, or a timer, or a call of the owner. After https://mavlink.io/en/services/mission.html;
where real autopilots answer errors and carry on (ArduPilot: out of order; PX4: busy), such an ACK is only
trouble, which ends the transfer if nothing better follows.
"""

from __future__ import annotations

from enum import Enum
from typing import Final


class ClientState(Enum):
    """What the ground station is doing."""

    READY = "not started"
    COUNTING = "upload: COUNT sent"
    UPLOADING = "upload: answering requests"
    CONFIRMING = "upload: every item sent, waiting for the ACK"
    LISTING = "download: LIST sent"
    DOWNLOADING = "download: asking for items"
    CLEARING = "clear: CLEAR_ALL sent"
    COMPLETE = "complete"
    FAILED = "failed"


class ClientInput(Enum):
    """What can happen to it."""

    START_UPLOAD = "start of an upload"
    START_DOWNLOAD = "start of a download"
    START_CLEAR = "start of a clear, or of the upload of an empty plan"
    REQUEST = "REQUEST of an item"
    REQUEST_LAST = "REQUEST of the only item that was never sent"
    REQUEST_REPEATED = "REQUEST of an item that was answered less than a round trip ago"
    COUNT = "COUNT"
    COUNT_EMPTY = "COUNT 0"
    ITEM = "an item that was missing"
    ITEM_LAST = "the last item that was missing"
    ITEM_BROKEN = "an item with impossible values"
    ACK_ACCEPTED = "ACK ACCEPTED"
    ACK_TROUBLE = "ACK ERROR, INVALID_SEQUENCE or DENIED"
    ACK_REFUSED = "any other ACK"
    STRAY = "anything else: echoes, other plan types, ACCEPTED too early"
    RETRY = "retry timer"
    RESTART = "retry timer, and asking for the item again does not help"
    GIVE_UP = "no progress for too long"
    CANCEL = "the owner cancels"


class ClientAction(Enum):
    """What it does about it."""

    SEND_OPENING = "send opening"
    IGNORE = "ignore"
    FAIL_UNSTARTED = "fail unstarted"
    SEND_ITEM = "send item"
    NOTE_TROUBLE = "note trouble"
    FAIL_REFUSED = "fail refused"
    REPEAT_OPENING = "repeat opening"
    FAIL_SILENT = "fail silent"
    FAIL_CANCELLED = "fail cancelled"
    NOTE_REQUEST = "note request"
    REPEAT_ITEM = "repeat item"
    COMPLETE = "complete"
    ASK_FIRST = "ask first"
    TAKE_ITEM = "take item"
    FAIL_BROKEN = "fail broken"
    ASK_AGAIN = "ask again"
    RESTART = "restart"


_I = ClientInput
_A = ClientAction
READY, COUNTING, UPLOADING, CONFIRMING, LISTING, DOWNLOADING, CLEARING, COMPLETE, FAILED = ClientState

CLIENT_TABLE: Final[dict[tuple[ClientState, ClientInput], tuple[ClientAction, ClientState]]] = {
    # not started
    (READY, _I.START_UPLOAD): (_A.SEND_OPENING, COUNTING),
    (READY, _I.START_DOWNLOAD): (_A.SEND_OPENING, LISTING),
    (READY, _I.START_CLEAR): (_A.SEND_OPENING, CLEARING),
    (READY, _I.STRAY): (_A.IGNORE, READY),
    (READY, _I.CANCEL): (_A.FAIL_UNSTARTED, FAILED),
    # upload: COUNT sent
    (COUNTING, _I.REQUEST): (_A.SEND_ITEM, UPLOADING),
    (COUNTING, _I.REQUEST_LAST): (_A.SEND_ITEM, CONFIRMING),
    (COUNTING, _I.ACK_TROUBLE): (_A.NOTE_TROUBLE, COUNTING),
    (COUNTING, _I.ACK_REFUSED): (_A.FAIL_REFUSED, FAILED),
    (COUNTING, _I.STRAY): (_A.IGNORE, COUNTING),
    (COUNTING, _I.RETRY): (_A.REPEAT_OPENING, COUNTING),
    (COUNTING, _I.GIVE_UP): (_A.FAIL_SILENT, FAILED),
    (COUNTING, _I.CANCEL): (_A.FAIL_CANCELLED, FAILED),
    # upload: answering requests
    (UPLOADING, _I.REQUEST): (_A.SEND_ITEM, UPLOADING),
    (UPLOADING, _I.REQUEST_LAST): (_A.SEND_ITEM, CONFIRMING),
    (UPLOADING, _I.REQUEST_REPEATED): (_A.NOTE_REQUEST, UPLOADING),
    (UPLOADING, _I.ACK_TROUBLE): (_A.NOTE_TROUBLE, UPLOADING),
    (UPLOADING, _I.ACK_REFUSED): (_A.FAIL_REFUSED, FAILED),
    (UPLOADING, _I.STRAY): (_A.IGNORE, UPLOADING),
    (UPLOADING, _I.RETRY): (_A.REPEAT_ITEM, UPLOADING),
    (UPLOADING, _I.GIVE_UP): (_A.FAIL_SILENT, FAILED),
    (UPLOADING, _I.CANCEL): (_A.FAIL_CANCELLED, FAILED),
    # upload: every item sent
    (CONFIRMING, _I.REQUEST): (_A.SEND_ITEM, CONFIRMING),
    (CONFIRMING, _I.REQUEST_REPEATED): (_A.NOTE_REQUEST, CONFIRMING),
    (CONFIRMING, _I.ACK_ACCEPTED): (_A.COMPLETE, COMPLETE),
    (CONFIRMING, _I.ACK_TROUBLE): (_A.NOTE_TROUBLE, CONFIRMING),
    (CONFIRMING, _I.ACK_REFUSED): (_A.FAIL_REFUSED, FAILED),
    (CONFIRMING, _I.STRAY): (_A.IGNORE, CONFIRMING),
    (CONFIRMING, _I.RETRY): (_A.REPEAT_ITEM, CONFIRMING),
    (CONFIRMING, _I.GIVE_UP): (_A.FAIL_SILENT, FAILED),
    (CONFIRMING, _I.CANCEL): (_A.FAIL_CANCELLED, FAILED),
    # download: LIST sent
    (LISTING, _I.COUNT): (_A.ASK_FIRST, DOWNLOADING),
    (LISTING, _I.COUNT_EMPTY): (_A.COMPLETE, COMPLETE),
    (LISTING, _I.ACK_TROUBLE): (_A.NOTE_TROUBLE, LISTING),
    (LISTING, _I.ACK_REFUSED): (_A.FAIL_REFUSED, FAILED),
    (LISTING, _I.STRAY): (_A.IGNORE, LISTING),
    (LISTING, _I.RETRY): (_A.REPEAT_OPENING, LISTING),
    (LISTING, _I.GIVE_UP): (_A.FAIL_SILENT, FAILED),
    (LISTING, _I.CANCEL): (_A.FAIL_CANCELLED, FAILED),
    # download: asking for items
    (DOWNLOADING, _I.ITEM): (_A.TAKE_ITEM, DOWNLOADING),
    (DOWNLOADING, _I.ITEM_LAST): (_A.COMPLETE, COMPLETE),
    (DOWNLOADING, _I.ITEM_BROKEN): (_A.FAIL_BROKEN, FAILED),
    (DOWNLOADING, _I.ACK_TROUBLE): (_A.NOTE_TROUBLE, DOWNLOADING),
    (DOWNLOADING, _I.ACK_REFUSED): (_A.FAIL_REFUSED, FAILED),
    (DOWNLOADING, _I.STRAY): (_A.IGNORE, DOWNLOADING),
    (DOWNLOADING, _I.RETRY): (_A.ASK_AGAIN, DOWNLOADING),
    (DOWNLOADING, _I.RESTART): (_A.RESTART, LISTING),
    (DOWNLOADING, _I.GIVE_UP): (_A.FAIL_SILENT, FAILED),
    (DOWNLOADING, _I.CANCEL): (_A.FAIL_CANCELLED, FAILED),
    # clear
    (CLEARING, _I.ACK_ACCEPTED): (_A.COMPLETE, COMPLETE),
    (CLEARING, _I.ACK_TROUBLE): (_A.NOTE_TROUBLE, CLEARING),
    (CLEARING, _I.ACK_REFUSED): (_A.FAIL_REFUSED, FAILED),
    (CLEARING, _I.STRAY): (_A.IGNORE, CLEARING),
    (CLEARING, _I.RETRY): (_A.REPEAT_OPENING, CLEARING),
    (CLEARING, _I.GIVE_UP): (_A.FAIL_SILENT, FAILED),
    (CLEARING, _I.CANCEL): (_A.FAIL_CANCELLED, FAILED),
    # over
    (COMPLETE, _I.STRAY): (_A.IGNORE, COMPLETE),
    (FAILED, _I.STRAY): (_A.IGNORE, FAILED),
}
