"""Transition table of the ground station's side of the mission protocol.

Each row maps a state and an input to an action (the method of that name) and the next state. An input is a
message classified for the state, a timer, or a call of the owner. Source:
https://mavlink.io/en/services/mission.html. Real autopilots continue after some error ACKs (ArduPilot: out of
order; PX4: busy before an upload starts). Such an ACK is "trouble": the transfer fails only if no progress
follows. An ERROR after an item was sent ends an upload immediately, because PX4 has aborted the upload.
"""

from __future__ import annotations

from enum import Enum
from typing import Final


class ClientState(Enum):
    """State of a transfer on the ground station."""

    READY = "not started"
    COUNTING = "upload: COUNT sent"
    UPLOADING = "upload: answering requests"
    CONFIRMING = "upload: every item sent, waiting for the ACK"
    LISTING = "download: LIST sent"
    DOWNLOADING = "download: requesting items"
    CLEARING = "clear: CLEAR_ALL sent"
    COMPLETE = "complete"
    FAILED = "failed"


class ClientInput(Enum):
    """Input of the transition table."""

    START_UPLOAD = "start of an upload"
    START_DOWNLOAD = "start of a download"
    START_CLEAR = "start of a clear, or of the upload of an empty plan"
    REQUEST = "REQUEST of an item"
    REQUEST_LAST = "REQUEST of the last unsent item"
    REQUEST_REPEATED = "REQUEST of an item that was answered less than a round trip ago"
    COUNT = "COUNT"
    COUNT_EMPTY = "COUNT 0"
    ITEM = "a missing item"
    ITEM_LAST = "the last missing item"
    ITEM_BROKEN = "an item with impossible values"
    ACK_ACCEPTED = "ACK ACCEPTED"
    ACK_TROUBLE = "ACK ERROR, INVALID_SEQUENCE or DENIED"
    ACK_GIVEN_UP = "ACK ERROR after an item was sent"
    ACK_REFUSED = "any other ACK"
    STRAY = "anything else: echoes, other plan types, ACCEPTED too early"
    RETRY = "retry timer"
    RESTART = "retry timer after too many requests for an item"
    GIVE_UP = "no progress for too long"
    CANCEL = "the owner cancels"


_I = ClientInput
READY, COUNTING, UPLOADING, CONFIRMING, LISTING, DOWNLOADING, CLEARING, COMPLETE, FAILED = ClientState

CLIENT_TABLE: Final[dict[tuple[ClientState, ClientInput], tuple[str, ClientState]]] = {
    # not started
    (READY, _I.START_UPLOAD): ("send opening", COUNTING),
    (READY, _I.START_DOWNLOAD): ("send opening", LISTING),
    (READY, _I.START_CLEAR): ("send opening", CLEARING),
    (READY, _I.STRAY): ("ignore", READY),
    (READY, _I.CANCEL): ("fail unstarted", FAILED),
    # upload: COUNT sent
    (COUNTING, _I.REQUEST): ("send item", UPLOADING),
    (COUNTING, _I.REQUEST_LAST): ("send item", CONFIRMING),
    (COUNTING, _I.ACK_TROUBLE): ("note trouble", COUNTING),
    (COUNTING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (COUNTING, _I.STRAY): ("ignore", COUNTING),
    (COUNTING, _I.RETRY): ("repeat opening", COUNTING),
    (COUNTING, _I.GIVE_UP): ("fail silent", FAILED),
    (COUNTING, _I.CANCEL): ("fail cancelled", FAILED),
    # upload: answering requests
    (UPLOADING, _I.REQUEST): ("send item", UPLOADING),
    (UPLOADING, _I.REQUEST_LAST): ("send item", CONFIRMING),
    (UPLOADING, _I.REQUEST_REPEATED): ("note request", UPLOADING),
    (UPLOADING, _I.ACK_TROUBLE): ("note trouble", UPLOADING),
    (UPLOADING, _I.ACK_GIVEN_UP): ("fail given up", FAILED),
    (UPLOADING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (UPLOADING, _I.STRAY): ("ignore", UPLOADING),
    (UPLOADING, _I.RETRY): ("repeat item", UPLOADING),
    (UPLOADING, _I.GIVE_UP): ("fail silent", FAILED),
    (UPLOADING, _I.CANCEL): ("fail cancelled", FAILED),
    # upload: every item sent
    (CONFIRMING, _I.REQUEST): ("send item", CONFIRMING),
    (CONFIRMING, _I.REQUEST_REPEATED): ("note request", CONFIRMING),
    (CONFIRMING, _I.ACK_ACCEPTED): ("complete", COMPLETE),
    (CONFIRMING, _I.ACK_TROUBLE): ("note trouble", CONFIRMING),
    (CONFIRMING, _I.ACK_GIVEN_UP): ("fail given up", FAILED),
    (CONFIRMING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (CONFIRMING, _I.STRAY): ("ignore", CONFIRMING),
    (CONFIRMING, _I.RETRY): ("repeat item", CONFIRMING),
    (CONFIRMING, _I.GIVE_UP): ("fail silent", FAILED),
    (CONFIRMING, _I.CANCEL): ("fail cancelled", FAILED),
    # download: LIST sent
    (LISTING, _I.COUNT): ("ask first", DOWNLOADING),
    (LISTING, _I.COUNT_EMPTY): ("complete", COMPLETE),
    (LISTING, _I.ACK_TROUBLE): ("note trouble", LISTING),
    (LISTING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (LISTING, _I.STRAY): ("ignore", LISTING),
    (LISTING, _I.RETRY): ("repeat opening", LISTING),
    (LISTING, _I.GIVE_UP): ("fail silent", FAILED),
    (LISTING, _I.CANCEL): ("fail cancelled", FAILED),
    # download: requesting items
    (DOWNLOADING, _I.ITEM): ("take item", DOWNLOADING),
    (DOWNLOADING, _I.ITEM_LAST): ("complete", COMPLETE),
    (DOWNLOADING, _I.ITEM_BROKEN): ("fail broken", FAILED),
    (DOWNLOADING, _I.ACK_TROUBLE): ("note trouble", DOWNLOADING),
    (DOWNLOADING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (DOWNLOADING, _I.STRAY): ("ignore", DOWNLOADING),
    (DOWNLOADING, _I.RETRY): ("ask again", DOWNLOADING),
    (DOWNLOADING, _I.RESTART): ("restart", LISTING),
    (DOWNLOADING, _I.GIVE_UP): ("fail silent", FAILED),
    (DOWNLOADING, _I.CANCEL): ("fail cancelled", FAILED),
    # clear
    (CLEARING, _I.ACK_ACCEPTED): ("complete", COMPLETE),
    (CLEARING, _I.ACK_TROUBLE): ("note trouble", CLEARING),
    (CLEARING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (CLEARING, _I.STRAY): ("ignore", CLEARING),
    (CLEARING, _I.RETRY): ("repeat opening", CLEARING),
    (CLEARING, _I.GIVE_UP): ("fail silent", FAILED),
    (CLEARING, _I.CANCEL): ("fail cancelled", FAILED),
    # over
    (COMPLETE, _I.STRAY): ("ignore", COMPLETE),
    (FAILED, _I.STRAY): ("ignore", FAILED),
}
