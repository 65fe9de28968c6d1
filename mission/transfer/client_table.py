"""The ground station's side of the mission protocol as one table.

Each row reads: in this state, on this input, do this and go there. An input is a message already judged
against the state, or a timer, or a wish of the owner. After https://mavlink.io/en/services/mission.html;
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


_I = ClientInput
READY, COUNTING, UPLOADING, CONFIRMING, LISTING, DOWNLOADING, CLEARING, COMPLETE, FAILED = ClientState

CLIENT_TABLE: Final[dict[tuple[ClientState, ClientInput], tuple[str, ClientState]]] = {
    # not started
    (READY, _I.START_UPLOAD): ("send_opening", COUNTING),
    (READY, _I.START_DOWNLOAD): ("send_opening", LISTING),
    (READY, _I.START_CLEAR): ("send_opening", CLEARING),
    (READY, _I.STRAY): ("ignore", READY),
    (READY, _I.CANCEL): ("fail_unstarted", FAILED),
    # upload: COUNT sent
    (COUNTING, _I.REQUEST): ("send_item", UPLOADING),
    (COUNTING, _I.REQUEST_LAST): ("send_item", CONFIRMING),
    (COUNTING, _I.ACK_TROUBLE): ("note_trouble", COUNTING),
    (COUNTING, _I.ACK_REFUSED): ("fail_refused", FAILED),
    (COUNTING, _I.STRAY): ("ignore", COUNTING),
    (COUNTING, _I.RETRY): ("repeat_opening", COUNTING),
    (COUNTING, _I.GIVE_UP): ("fail_silent", FAILED),
    (COUNTING, _I.CANCEL): ("fail_cancelled", FAILED),
    # upload: answering requests
    (UPLOADING, _I.REQUEST): ("send_item", UPLOADING),
    (UPLOADING, _I.REQUEST_LAST): ("send_item", CONFIRMING),
    (UPLOADING, _I.REQUEST_REPEATED): ("note_request", UPLOADING),
    (UPLOADING, _I.ACK_TROUBLE): ("note_trouble", UPLOADING),
    (UPLOADING, _I.ACK_REFUSED): ("fail_refused", FAILED),
    (UPLOADING, _I.STRAY): ("ignore", UPLOADING),
    (UPLOADING, _I.RETRY): ("repeat_item", UPLOADING),
    (UPLOADING, _I.GIVE_UP): ("fail_silent", FAILED),
    (UPLOADING, _I.CANCEL): ("fail_cancelled", FAILED),
    # upload: every item sent
    (CONFIRMING, _I.REQUEST): ("send_item", CONFIRMING),
    (CONFIRMING, _I.REQUEST_REPEATED): ("note_request", CONFIRMING),
    (CONFIRMING, _I.ACK_ACCEPTED): ("complete", COMPLETE),
    (CONFIRMING, _I.ACK_TROUBLE): ("note_trouble", CONFIRMING),
    (CONFIRMING, _I.ACK_REFUSED): ("fail_refused", FAILED),
    (CONFIRMING, _I.STRAY): ("ignore", CONFIRMING),
    (CONFIRMING, _I.RETRY): ("repeat_item", CONFIRMING),
    (CONFIRMING, _I.GIVE_UP): ("fail_silent", FAILED),
    (CONFIRMING, _I.CANCEL): ("fail_cancelled", FAILED),
    # download: LIST sent
    (LISTING, _I.COUNT): ("ask_first", DOWNLOADING),
    (LISTING, _I.COUNT_EMPTY): ("complete", COMPLETE),
    (LISTING, _I.ACK_TROUBLE): ("note_trouble", LISTING),
    (LISTING, _I.ACK_REFUSED): ("fail_refused", FAILED),
    (LISTING, _I.STRAY): ("ignore", LISTING),
    (LISTING, _I.RETRY): ("repeat_opening", LISTING),
    (LISTING, _I.GIVE_UP): ("fail_silent", FAILED),
    (LISTING, _I.CANCEL): ("fail_cancelled", FAILED),
    # download: asking for items
    (DOWNLOADING, _I.ITEM): ("take_item", DOWNLOADING),
    (DOWNLOADING, _I.ITEM_LAST): ("complete", COMPLETE),
    (DOWNLOADING, _I.ITEM_BROKEN): ("fail_broken", FAILED),
    (DOWNLOADING, _I.ACK_TROUBLE): ("note_trouble", DOWNLOADING),
    (DOWNLOADING, _I.ACK_REFUSED): ("fail_refused", FAILED),
    (DOWNLOADING, _I.STRAY): ("ignore", DOWNLOADING),
    (DOWNLOADING, _I.RETRY): ("ask_again", DOWNLOADING),
    (DOWNLOADING, _I.RESTART): ("restart", LISTING),
    (DOWNLOADING, _I.GIVE_UP): ("fail_silent", FAILED),
    (DOWNLOADING, _I.CANCEL): ("fail_cancelled", FAILED),
    # clear
    (CLEARING, _I.ACK_ACCEPTED): ("complete", COMPLETE),
    (CLEARING, _I.ACK_TROUBLE): ("note_trouble", CLEARING),
    (CLEARING, _I.ACK_REFUSED): ("fail_refused", FAILED),
    (CLEARING, _I.STRAY): ("ignore", CLEARING),
    (CLEARING, _I.RETRY): ("repeat_opening", CLEARING),
    (CLEARING, _I.GIVE_UP): ("fail_silent", FAILED),
    (CLEARING, _I.CANCEL): ("fail_cancelled", FAILED),
    # over
    (COMPLETE, _I.STRAY): ("ignore", COMPLETE),
    (FAILED, _I.STRAY): ("ignore", FAILED),
}
