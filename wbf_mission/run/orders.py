"""Orders of a watcher to vehicles in flight: given in the watcher's thread, carried out in the flight's."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

from geo.system import steady_s
from geo.texts import one_line
from mission.ground.command import OperatorCommand, OrderError
from mission.ground.standstill import LIFE_S
from wbf_mission.events import Asked, EventStream, Orderable

__all__ = ["IN_FLIGHT", "LIFE_S", "START", "Orders", "WatchersOrder", "too_late"]

START = "start"
"""Starts a mission: arms the vehicle, too, where its motors stand."""
STARTS_MOTORS = frozenset({START, "arm", "takeoff"})
ENDS_FLIGHT = frozenset({"return", "land"})
"""Need confirmation for more than one vehicle; orders that start motors always need it."""
IN_FLIGHT = ("hold", "resume", "return", "land", "set item")
"""The words that a page shows; a command's are the same with hyphens."""
_MOST_WAITING = 100


def too_late(age_s: float) -> str:
    """Return why an order or answer of this age is refused, empty if it is not.

    >>> too_late(1.9), too_late(14.2)
    ('', 'too late: it was given 14 s ago; look at the page, and give it again')
    """
    if age_s <= LIFE_S:
        return ""
    return f"too late: it was given {age_s:.0f} s ago; look at the page, and give it again"


@dataclass(frozen=True, slots=True)
class WatchersOrder:
    """An order to the vehicles with these system ids, and to no other one that is heard later.

    Examples
    --------
    >>> str(WatchersOrder("set item", "3", (1,)))
    'ordered by the page: set item 3'
    """

    order: str
    value: str
    system_ids: tuple[int, ...]

    def is_for(self, system_id: int) -> bool:
        """Return whether it is for a vehicle."""
        return system_id in self.system_ids

    def __str__(self) -> str:
        return f"ordered by the page: {self.order} {one_line(self.value, 40)}".rstrip()

    @property
    def command(self) -> OperatorCommand:
        """The command that it is, unless it is to start; OrderError if its value is none."""
        return OperatorCommand(self.order.replace(" ", "-"), self.value)


class Orders:
    """Queue of orders and answers from a watcher to the flight. Thread-safe.

    The thread of the flight sets the possible orders (`allow`), asks questions (`ask`), and takes orders and
    answers (`taken`, `answered`). An order that is not possible now is refused at once.

    Parameters
    ----------
    events : EventStream
        Receives the possible orders, the questions, and lines about orders and their outcome.
    clock : callable, optional
        Returns seconds; an order that waits longer than `LIFE_S` is dropped.

    Examples
    --------
    >>> orders = Orders(EventStream())
    >>> orders.allow(("hold", "start"), {1})
    >>> orders.take([1], "start")
    'start starts motors: it has to be confirmed'
    >>> orders.take([1], "hold"), orders.taken()
    ('', [WatchersOrder(order='hold', value='', system_ids=(1,))])
    """

    def __init__(
        self,
        events: EventStream,
        clock: Callable[[], float] = steady_s,
    ) -> None:
        self._events, self._clock = events, clock
        self.note, self.warn = events.note, events.warn
        self._lock = threading.Lock()
        self._orders: tuple[str, ...] = ()
        self._vehicles: frozenset[int] = frozenset()
        # With the time at which each was given
        self._waiting: deque[tuple[float, WatchersOrder]] = deque()
        self._question = Asked("")
        self._answer: tuple[float, str] | None = None

    # Called by the watcher.

    def take(
        self,
        system_ids: Collection[int],
        order: str,
        value: str = "",
        confirmed: bool = False,
        *,
        age_s: float = 0.0,
    ) -> str:
        """Take an order; return why it is refused, empty if it is taken.

        Parameters
        ----------
        system_ids : collection of int
            Of the vehicles that are meant. Those of them take it that can.
        order, value : str
            One of those that are possible now, and what it takes: a takeoff a height above home in metres,
            "set item" the number of an item, from 1.
        confirmed : bool
            Who watches has said twice that motors may start, or that more than one vehicle is to come down.
        age_s : float
            How long ago it was given.
        """
        with self._lock:
            if order not in self._orders:
                return f"{one_line(order, 40)!r} cannot be ordered now"
            if self._vehicles.isdisjoint(system_ids):
                named = ", ".join(map(str, sorted(system_ids)[:3])) or "named"
                return f"there is no vehicle {named} to take it"
            if order in STARTS_MOTORS and confirmed is not True:
                return f"{order} starts motors: it has to be confirmed"
            if order in ENDS_FLIGHT and len(system_ids) > 1 and confirmed is not True:
                return f"{order} is for {len(system_ids)} vehicles: it has to be confirmed"
            given = WatchersOrder(order, value, tuple(sorted(system_ids)))
            try:
                if order != START:
                    _ = given.command
            except OrderError as error:
                return str(error)
            if refused := too_late(age_s):
                return refused
            if len(self._waiting) >= _MOST_WAITING:
                return "too many orders wait already"
            self._waiting.append((self._clock() - age_s, given))
        return ""

    def answer(self, text: str, question: int, *, age_s: float = 0.0) -> str:
        """Take the answer to the question of this number; return why it is refused, empty if it is not."""
        with self._lock:
            if question != self._question.number:
                return "the question is another one by now: look at the page"
            if text not in self._question.answers:
                known = " or ".join(self._question.answers)
                return f"{one_line(text, 40)!r} answers nothing" + f": give {known}" * bool(known)
            if refused := too_late(age_s):
                return refused
            self._answer = self._clock() - age_s, text
        return ""

    # Called by the flight.

    def allow(self, orders: Collection[str], vehicles: Collection[int]) -> None:
        """Set the orders that are possible from now on, and their vehicles."""
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
        """Return the orders since the last call; warn of those that waited too long, and leave them out."""
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
        fresh, now_s = [], self._clock()
        for given_s, order in waiting:
            if refused := too_late(now_s - given_s):
                self.warn(f"{order}: {refused}")
            else:
                fresh.append(order)
        return fresh

    def ask(self, question: str, answers: Collection[str] = ()) -> None:
        """Ask a question that these words answer, in place of the one before; an empty one ends it."""
        with self._lock:
            asked = Asked(question, tuple(answers), self._question.number + 1)
            changed = self._question != asked
            if changed:
                self._question, self._answer = asked, None
        if changed:
            self._events.tell(asked)

    def answered(self) -> str | None:
        """Return the answer, None while there is none; warn of one that waited too long, and leave it out."""
        with self._lock:
            answer, self._answer = self._answer, None
        if answer is None:
            return None
        given_s, text = answer
        if refused := too_late(self._clock() - given_s):
            self.warn(f"answered by the page: {text}: {refused}")
            return None
        return text
