"""What who watches a flight orders: taken in the watcher's thread, carried out in that of the flight."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

from geo.texts import one_line
from mission.ground.command import OperatorCommand, OrderError
from wbf_mission.events import Asked, EventStream, Noted, Orderable

__all__ = ["IN_FLIGHT", "START", "Orders", "WatchersOrder"]

START = "start"
"""Starts a mission: arms the vehicle, too, where its motors stand."""
STARTS_MOTORS = frozenset({START, "arm", "takeoff"})
IN_FLIGHT = ("hold", "resume", "return", "land", "set item")
"""The words that a page shows; a command's are the same with hyphens."""
_MOST_WAITING = 100


@dataclass(frozen=True, slots=True)
class WatchersOrder:
    """An order; `system_id` None is for every vehicle.

    Examples
    --------
    >>> str(WatchersOrder("set item", "3"))
    'ordered by the page: set item 3'
    """

    order: str
    value: str = ""
    system_id: int | None = None

    def is_for(self, system_id: int) -> bool:
        """Return whether it is for a vehicle."""
        return self.system_id in (None, system_id)

    def __str__(self) -> str:
        return f"ordered by the page: {self.order} {one_line(self.value, 40)}".rstrip()

    @property
    def command(self) -> OperatorCommand:
        """The command that it is, unless it is to start; OrderError if its value is none."""
        return OperatorCommand(self.order.replace(" ", "-"), self.value)


class Orders:
    """Hands orders and answers on from who watches to who flies. Thread-safe.

    Whose thread flies the vehicles says what may be ordered (`allow`), asks questions (`ask`), and takes what
    came (`taken`, `answered`). What a watcher may not order now is refused to it at once.

    Parameters
    ----------
    events : EventStream
        Takes what may be ordered, and the questions.
    note, warn : callable, optional
        Take lines for the operator: what was ordered and what came of it; without, `events` does.

    Examples
    --------
    >>> orders = Orders(EventStream())
    >>> orders.allow(("hold", "start"), {1})
    >>> orders.take(None, "start")
    'start starts motors: it has to be confirmed'
    >>> orders.take(1, "hold"), orders.taken()
    ('', [WatchersOrder(order='hold', value='', system_id=1)])
    """

    def __init__(
        self,
        events: EventStream,
        note: Callable[[str], None] | None = None,
        warn: Callable[[str], None] | None = None,
    ) -> None:
        self._events = events
        self.note = note or (lambda text: events.tell(Noted(text)))
        self.warn = warn or (lambda text: events.tell(Noted(text, warns=True)))
        self._lock = threading.Lock()
        self._orders: tuple[str, ...] = ()
        self._vehicles: frozenset[int] = frozenset()
        self._waiting: deque[WatchersOrder] = deque()
        self._question = Asked("")
        self._answer: str | None = None

    # What who watches calls.

    def take(self, system_id: int | None, order: str, value: str = "", confirmed: bool = False) -> str:
        """Take an order; return why it is refused, empty if it is taken.

        Parameters
        ----------
        system_id : int or None
            Of the vehicle; None for all.
        order, value : str
            One of those that are possible now, and what it takes: a takeoff a height above home in metres,
            "set item" the number of an item, from 1.
        confirmed : bool
            Who watches has said twice that motors may start.
        """
        with self._lock:
            if order not in self._orders:
                return f"{one_line(order, 40)!r} cannot be ordered now"
            if system_id is not None and system_id not in self._vehicles:
                return f"there is no vehicle {system_id} to take it"
            if order in STARTS_MOTORS and confirmed is not True:
                return f"{order} starts motors: it has to be confirmed"
            given = WatchersOrder(order, value, system_id)
            try:
                if order != START:
                    _ = given.command
            except OrderError as error:
                return str(error)
            if len(self._waiting) >= _MOST_WAITING:
                return "too many orders wait already"
            self._waiting.append(given)
        return ""

    def answer(self, text: str) -> str:
        """Take the answer to the question that is open; return why it is refused, empty if it is taken."""
        with self._lock:
            if text not in self._question.answers:
                known = " or ".join(self._question.answers)
                return f"{one_line(text, 40)!r} answers nothing" + f": give {known}" * bool(known)
            self._answer = text
        return ""

    # What who flies calls.

    def allow(self, orders: Collection[str], vehicles: Collection[int]) -> None:
        """Say what may be ordered from now on, and of which vehicles."""
        with self._lock:
            changed = self._orders != tuple(orders)
            self._orders, self._vehicles = tuple(orders), frozenset(vehicles)
            if not self._orders:
                # What came too late for one flight is not for the next.
                self._waiting.clear()
        if changed:
            self._events.tell(Orderable(tuple(orders)))

    @property
    def waits(self) -> bool:
        """Whether an order waits to be taken."""
        return bool(self._waiting)

    def taken(self) -> list[WatchersOrder]:
        """Take the orders that came since the last call."""
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
        return waiting

    def ask(self, question: str, answers: Collection[str] = ()) -> None:
        """Ask a question that these words answer, in place of the one before; an empty one ends it."""
        asked = Asked(question, tuple(answers))
        with self._lock:
            changed = self._question != asked
            if changed:
                self._question, self._answer = asked, None
        if changed:
            self._events.tell(asked)

    def answered(self) -> str | None:
        """Take the answer, None while there is none."""
        with self._lock:
            answer, self._answer = self._answer, None
        return answer
