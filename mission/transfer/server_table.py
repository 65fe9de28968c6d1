"""The vehicle's side of the mission protocol as one table.

Each row reads: in this state, on this input, do this and go there. An input is a message already judged
against the state (whose it is, whether it fits), or a timer. After
https://mavlink.io/en/services/mission.html and PX4's ``mavlink_mission.cpp``; where ArduPilot does
otherwise, the profile decides which input a message becomes.
"""

from __future__ import annotations

from enum import Enum
from typing import Final


class ServerState(Enum):
    """What the vehicle is doing."""

    IDLE = "idle"
    RECEIVING = "receiving a plan"
    SENDING = "sending a plan"


class ServerInput(Enum):
    """What can happen to it."""

    COUNT = "COUNT that fits"
    COUNT_EMPTY = "COUNT 0"
    COUNT_TOO_LARGE = "COUNT beyond the capacity"
    COUNT_REPEATED = "COUNT again from the partner before item 0 (ArduPilot: at any time)"
    COUNT_BUSY = "COUNT while a transfer runs (PX4: also for a while after COUNT 0)"
    BAD_TYPE = "COUNT, LIST or CLEAR of an unknown plan type"
    ITEM_NEXT = "the item that was asked for"
    ITEM_LAST = "the last item that was missing"
    ITEM_REFUSED = "the item that was asked for, but it cannot be flown"
    ITEM_OUT_OF_ORDER = "another item than the one asked for"
    ITEM_WRONG_TYPE = "item of another plan type"
    ITEM_FOREIGN = "item from another ground station"
    ITEM_REPEATED = "the item that ended the last upload, again"
    ITEM_STALE = "an item of the plan that was just received, again"
    ITEM_UNEXPECTED = "item that nobody asked for"
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
    ACK_OTHER = "ACK from somebody else, of another type, or too early"
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


class ServerAction(Enum):
    """What it does about it."""

    ASK_FIRST = "ask first"
    CLEAR_BY_COUNT = "clear by count"
    REFUSE_SPACE = "refuse space"
    REFUSE_BUSY = "refuse busy"
    REFUSE_TYPE = "refuse type"
    REPEAT_ACK = "repeat ack"
    IGNORE = "ignore"
    REFUSE_UNEXPECTED_ITEM = "refuse unexpected item"
    SEND_COUNT = "send count"
    SEND_ITEM = "send item"
    ANSWER_BEYOND = "answer beyond"
    REFUSE_REQUEST = "refuse request"
    CLEAR = "clear"
    REFUSE_CLEAR = "refuse clear"
    REFUSE_CLEAR_NOW = "refuse clear now"
    REFUSE_PARTIAL = "refuse partial"
    ASK_PART = "ask part"
    TAKE_ITEM = "take item"
    TAKE_LAST_ITEM = "take last item"
    REFUSE_ITEM = "refuse item"
    ANSWER_ORDER = "answer order"
    REFUSE_ITEM_TYPE = "refuse item type"
    REFUSE_FOREIGN_ITEM = "refuse foreign item"
    REFUSE_LIST = "refuse list"
    REFUSE_REQUEST_NOW = "refuse request now"
    END_CANCELLED = "end cancelled"
    ASK_AGAIN = "ask again"
    ABORT_UPLOAD = "abort upload"
    SAY_BUSY = "say busy"
    REFUSE_CHANGED = "refuse changed"
    REFUSE_JUMP = "refuse jump"
    END_SENT = "end sent"
    END_REFUSED = "end refused"
    ABORT_DOWNLOAD = "abort download"


_I = ServerInput
_A = ServerAction
IDLE, RECEIVING, SENDING = ServerState

SERVER_TABLE: Final[dict[tuple[ServerState, ServerInput], tuple[ServerAction, ServerState]]] = {
    # idle
    (IDLE, _I.COUNT): (_A.ASK_FIRST, RECEIVING),
    (IDLE, _I.COUNT_EMPTY): (_A.CLEAR_BY_COUNT, IDLE),
    (IDLE, _I.COUNT_TOO_LARGE): (_A.REFUSE_SPACE, IDLE),
    (IDLE, _I.COUNT_BUSY): (_A.REFUSE_BUSY, IDLE),
    (IDLE, _I.BAD_TYPE): (_A.REFUSE_TYPE, IDLE),
    (IDLE, _I.ITEM_REPEATED): (_A.REPEAT_ACK, IDLE),
    (IDLE, _I.ITEM_STALE): (_A.IGNORE, IDLE),
    (IDLE, _I.ITEM_UNEXPECTED): (_A.REFUSE_UNEXPECTED_ITEM, IDLE),
    (IDLE, _I.LIST): (_A.SEND_COUNT, SENDING),
    (IDLE, _I.LIST_STATELESS): (_A.SEND_COUNT, IDLE),
    (IDLE, _I.REQUEST_STATELESS): (_A.SEND_ITEM, IDLE),
    (IDLE, _I.REQUEST_BEYOND): (_A.ANSWER_BEYOND, IDLE),
    (IDLE, _I.REQUEST_UNEXPECTED): (_A.REFUSE_REQUEST, IDLE),
    (IDLE, _I.ACK_OTHER): (_A.IGNORE, IDLE),
    (IDLE, _I.CLEAR): (_A.CLEAR, IDLE),
    (IDLE, _I.CLEAR_UNSUPPORTED): (_A.REFUSE_CLEAR, IDLE),
    (IDLE, _I.CLEAR_LOCKED): (_A.REFUSE_CLEAR_NOW, IDLE),
    (IDLE, _I.PARTIAL): (_A.REFUSE_PARTIAL, IDLE),
    (IDLE, _I.WRITE): (_A.ASK_PART, RECEIVING),
    # receiving
    (RECEIVING, _I.COUNT_REPEATED): (_A.ASK_FIRST, RECEIVING),
    (RECEIVING, _I.COUNT_BUSY): (_A.REFUSE_BUSY, RECEIVING),
    (RECEIVING, _I.BAD_TYPE): (_A.REFUSE_TYPE, RECEIVING),
    (RECEIVING, _I.ITEM_NEXT): (_A.TAKE_ITEM, RECEIVING),
    (RECEIVING, _I.ITEM_LAST): (_A.TAKE_LAST_ITEM, IDLE),
    (RECEIVING, _I.ITEM_REFUSED): (_A.REFUSE_ITEM, IDLE),
    (RECEIVING, _I.ITEM_OUT_OF_ORDER): (_A.ANSWER_ORDER, RECEIVING),
    (RECEIVING, _I.ITEM_WRONG_TYPE): (_A.REFUSE_ITEM_TYPE, RECEIVING),
    (RECEIVING, _I.ITEM_FOREIGN): (_A.REFUSE_FOREIGN_ITEM, RECEIVING),
    (RECEIVING, _I.LIST_BUSY): (_A.REFUSE_LIST, RECEIVING),
    (RECEIVING, _I.REQUEST_FOREIGN): (_A.REFUSE_REQUEST_NOW, RECEIVING),
    (RECEIVING, _I.ACK_CANCEL): (_A.END_CANCELLED, IDLE),
    (RECEIVING, _I.ACK_OTHER): (_A.IGNORE, RECEIVING),
    (RECEIVING, _I.CLEAR_BUSY): (_A.REFUSE_CLEAR_NOW, RECEIVING),
    (RECEIVING, _I.PARTIAL): (_A.IGNORE, RECEIVING),
    (RECEIVING, _I.WRITE): (_A.IGNORE, RECEIVING),
    (RECEIVING, _I.ABANDONED): (_A.END_CANCELLED, IDLE),
    (RECEIVING, _I.RETRY): (_A.ASK_AGAIN, RECEIVING),
    (RECEIVING, _I.ABORT): (_A.ABORT_UPLOAD, IDLE),
    # sending
    (SENDING, _I.COUNT_BUSY): (_A.REFUSE_BUSY, SENDING),
    (SENDING, _I.BAD_TYPE): (_A.REFUSE_TYPE, SENDING),
    (SENDING, _I.ITEM_STALE): (_A.IGNORE, SENDING),
    (SENDING, _I.ITEM_FOREIGN): (_A.SAY_BUSY, SENDING),
    (SENDING, _I.LIST): (_A.SEND_COUNT, SENDING),
    (SENDING, _I.LIST_BUSY): (_A.REFUSE_LIST, SENDING),
    (SENDING, _I.REQUEST): (_A.SEND_ITEM, SENDING),
    (SENDING, _I.REQUEST_CHANGED): (_A.REFUSE_CHANGED, SENDING),
    (SENDING, _I.REQUEST_JUMP): (_A.REFUSE_JUMP, IDLE),
    (SENDING, _I.REQUEST_BEYOND): (_A.ANSWER_BEYOND, SENDING),
    (SENDING, _I.REQUEST_FOREIGN): (_A.IGNORE, SENDING),
    (SENDING, _I.ACK_DONE): (_A.END_SENT, IDLE),
    (SENDING, _I.ACK_CANCEL): (_A.END_CANCELLED, IDLE),
    (SENDING, _I.ACK_ERROR): (_A.END_REFUSED, IDLE),
    (SENDING, _I.ACK_OTHER): (_A.IGNORE, SENDING),
    (SENDING, _I.CLEAR_BUSY): (_A.SAY_BUSY, SENDING),
    (SENDING, _I.PARTIAL): (_A.IGNORE, SENDING),
    (SENDING, _I.IMPLIED_END): (_A.END_SENT, IDLE),
    (SENDING, _I.ABORT): (_A.ABORT_DOWNLOAD, IDLE),
}
