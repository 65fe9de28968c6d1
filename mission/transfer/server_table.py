"""Transition table of the vehicle's side of the mission protocol.

Each row maps a state and an input to an action (a refusal, or the method of that name) and the next state. An
input is a timer, or a message classified by sender and state. Sources:
https://mavlink.io/en/services/mission.html and PX4's ``mavlink_mission.cpp``. Where ArduPilot differs, the
profile changes the classification of messages.
"""

from __future__ import annotations

from enum import Enum
from typing import Final


class ServerState(Enum):
    """State of the vehicle's mission server."""

    IDLE = "idle"
    RECEIVING = "receiving a plan"
    SENDING = "sending a plan"


class ServerInput(Enum):
    """Input of the transition table."""

    COUNT = "COUNT that fits"
    COUNT_EMPTY = "COUNT 0"
    COUNT_TOO_LARGE = "COUNT beyond the capacity"
    COUNT_REPEATED = "COUNT again from the partner before item 0 (ArduPilot: at any time)"
    COUNT_BUSY = "COUNT while a transfer runs (PX4: also for a while after COUNT 0)"
    BAD_TYPE = "COUNT, LIST or CLEAR of an unknown plan type"
    ITEM_NEXT = "the requested item"
    ITEM_LAST = "the last missing item"
    ITEM_REFUSED = "the requested item, but invalid"
    ITEM_OUT_OF_ORDER = "an item out of order"
    ITEM_WRONG_TYPE = "item of another plan type"
    ITEM_FOREIGN = "item from another ground station"
    ITEM_REPEATED = "the item that ended the last upload, again"
    ITEM_STALE = "an item of the plan that was just received, again"
    ITEM_UNEXPECTED = "unrequested item"
    LIST = "LIST"
    LIST_STATELESS = "LIST (stateless profile)"
    LIST_BUSY = "LIST while another transfer runs"
    REQUEST = "REQUEST of the next item or one already sent"
    REQUEST_STATELESS = "REQUEST of any item (stateless profile)"
    REQUEST_JUMP = "REQUEST that skips items"
    REQUEST_BEYOND = "REQUEST beyond the plan"
    REQUEST_UNEXPECTED = "REQUEST without a LIST"
    REQUEST_FOREIGN = "REQUEST from another ground station or of another plan type"
    ACK_DONE = "ACK ACCEPTED from the partner after the last item"
    ACK_CANCEL = "ACK OPERATION_CANCELLED from the partner"
    ACK_ERROR = "any other ACK from the partner"
    ACK_OTHER = "ACK from another ground station, of another type, or too early"
    CLEAR = "CLEAR_ALL"
    CLEAR_UNSUPPORTED = "CLEAR_ALL of all types where the profile has none"
    CLEAR_LOCKED = "CLEAR_ALL while the plan is flown (ArduPilot)"
    CLEAR_BUSY = "CLEAR_ALL while a transfer runs"
    PARTIAL = "REQUEST_PARTIAL_LIST or WRITE_PARTIAL_LIST"
    WRITE = "WRITE_PARTIAL_LIST within the plan (ArduPilot)"
    REQUEST_CHANGED = "REQUEST (float) after REQUEST_INT in one download"
    IMPLIED_END = "COUNT or CLEAR_ALL from the partner after the last item was sent"
    ABANDONED = "LIST from the partner before it sent any item"
    RETRY = "re-request timer"
    ABORT = "abort timer"


_I = ServerInput
IDLE, RECEIVING, SENDING = ServerState

SERVER_TABLE: Final[dict[tuple[ServerState, ServerInput], tuple[str, ServerState]]] = {
    # idle
    (IDLE, _I.COUNT): ("ask first", RECEIVING),
    (IDLE, _I.COUNT_EMPTY): ("clear by count", IDLE),
    (IDLE, _I.COUNT_TOO_LARGE): ("refuse space", IDLE),
    (IDLE, _I.COUNT_BUSY): ("refuse busy", IDLE),
    (IDLE, _I.BAD_TYPE): ("refuse type", IDLE),
    (IDLE, _I.ITEM_REPEATED): ("repeat ack", IDLE),
    (IDLE, _I.ITEM_STALE): ("ignore", IDLE),
    (IDLE, _I.ITEM_UNEXPECTED): ("refuse unexpected item", IDLE),
    (IDLE, _I.LIST): ("send count", SENDING),
    (IDLE, _I.LIST_STATELESS): ("send count", IDLE),
    (IDLE, _I.REQUEST_STATELESS): ("send item", IDLE),
    (IDLE, _I.REQUEST_BEYOND): ("answer beyond", IDLE),
    (IDLE, _I.REQUEST_UNEXPECTED): ("refuse request", IDLE),
    (IDLE, _I.ACK_OTHER): ("ignore", IDLE),
    (IDLE, _I.CLEAR): ("clear", IDLE),
    (IDLE, _I.CLEAR_UNSUPPORTED): ("refuse clear", IDLE),
    (IDLE, _I.CLEAR_LOCKED): ("refuse clear now", IDLE),
    (IDLE, _I.PARTIAL): ("refuse partial", IDLE),
    (IDLE, _I.WRITE): ("ask part", RECEIVING),
    # receiving
    (RECEIVING, _I.COUNT_REPEATED): ("ask first", RECEIVING),
    (RECEIVING, _I.COUNT_BUSY): ("refuse busy", RECEIVING),
    (RECEIVING, _I.BAD_TYPE): ("refuse type", RECEIVING),
    (RECEIVING, _I.ITEM_NEXT): ("take item", RECEIVING),
    (RECEIVING, _I.ITEM_LAST): ("take last item", IDLE),
    (RECEIVING, _I.ITEM_REFUSED): ("refuse item", IDLE),
    (RECEIVING, _I.ITEM_OUT_OF_ORDER): ("answer order", RECEIVING),
    (RECEIVING, _I.ITEM_WRONG_TYPE): ("refuse item type", RECEIVING),
    (RECEIVING, _I.ITEM_FOREIGN): ("refuse foreign item", RECEIVING),
    (RECEIVING, _I.LIST_BUSY): ("refuse list", RECEIVING),
    (RECEIVING, _I.REQUEST_FOREIGN): ("refuse request now", RECEIVING),
    (RECEIVING, _I.ACK_CANCEL): ("end cancelled", IDLE),
    (RECEIVING, _I.ACK_OTHER): ("ignore", RECEIVING),
    (RECEIVING, _I.CLEAR_BUSY): ("refuse clear now", RECEIVING),
    (RECEIVING, _I.PARTIAL): ("ignore", RECEIVING),
    (RECEIVING, _I.WRITE): ("ignore", RECEIVING),
    (RECEIVING, _I.ABANDONED): ("end cancelled", IDLE),
    (RECEIVING, _I.RETRY): ("ask again", RECEIVING),
    (RECEIVING, _I.ABORT): ("abort upload", IDLE),
    # sending
    (SENDING, _I.COUNT_BUSY): ("refuse busy", SENDING),
    (SENDING, _I.BAD_TYPE): ("refuse type", SENDING),
    (SENDING, _I.ITEM_STALE): ("ignore", SENDING),
    (SENDING, _I.ITEM_FOREIGN): ("say busy", SENDING),
    (SENDING, _I.LIST): ("send count", SENDING),
    (SENDING, _I.LIST_BUSY): ("refuse list", SENDING),
    (SENDING, _I.REQUEST): ("send item", SENDING),
    (SENDING, _I.REQUEST_CHANGED): ("refuse changed", SENDING),
    (SENDING, _I.REQUEST_JUMP): ("refuse jump", IDLE),
    (SENDING, _I.REQUEST_BEYOND): ("answer beyond", SENDING),
    (SENDING, _I.REQUEST_FOREIGN): ("ignore", SENDING),
    (SENDING, _I.ACK_DONE): ("end sent", IDLE),
    (SENDING, _I.ACK_CANCEL): ("end cancelled", IDLE),
    (SENDING, _I.ACK_ERROR): ("end refused", IDLE),
    (SENDING, _I.ACK_OTHER): ("ignore", SENDING),
    (SENDING, _I.CLEAR_BUSY): ("say busy", SENDING),
    (SENDING, _I.PARTIAL): ("ignore", SENDING),
    (SENDING, _I.IMPLIED_END): ("end sent", IDLE),
    (SENDING, _I.ABORT): ("abort download", IDLE),
}
