"""Orders of a watcher to vehicles in flight; one thread queues them, and another carries them out."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

from geo.system import steady_s
from geo.texts import one_line
from mission.ground.arming_gate import LIFE_S
from mission.ground.command import OperatorCommand, OrderError
from wbf_mission.events import Asked, EventStream, Orderable

START = "start"
"""Order that starts a mission; it also arms a disarmed vehicle."""
STARTS_MOTORS = frozenset({START, "arm", "takeoff"})
ENDS_FLIGHT = frozenset({"return", "land"})
"""Orders that need confirmation if they are for several vehicles; orders that start motors always need it."""
IN_FLIGHT = ("hold", "resume", "return", "land", "set item")
"""Orders that are possible in flight, as a page shows them; command names have hyphens for spaces."""
_MOST_WAITING = 100


def too_late(age_s: float) -> str:
    """Return why an order or answer of this age is refused; empty if it is accepted.

    >>> too_late(1.9), too_late(14.2)
    ('', 'too late: it was given 14 s ago; look at the page, and give it again')
    """
    if age_s <= LIFE_S:
        return ""
    return f"too late: it was given {age_s:.0f} s ago; look at the page, and give it again"


@dataclass(frozen=True, slots=True)
class WatchersOrder:
    """An order to the vehicles with these system ids; the order does not reach vehicles that appear later.

    Examples
    --------
    >>> str(WatchersOrder("set item", "3", (1,)))
    'ordered by the page: set item 3'
    """

    order: str
    value: str
    system_ids: tuple[int, ...]

    def is_for(self, system_id: int) -> bool:
        """Return whether the order is for a vehicle."""
        return system_id in self.system_ids

    def __str__(self) -> str:
        return f"ordered by the page: {self.order} {one_line(self.value, 40)}".rstrip()

    @property
    def command(self) -> OperatorCommand:
        """The command for the order, which must not be a start; OrderError if the value is invalid."""
        return OperatorCommand(self.order.replace(" ", "-"), self.value)


class Orders:
    """Thread-safe queue of orders and answers from a watcher to the flight.

    The flight's thread sets the possible orders (`allow`), asks questions (`ask`), and takes orders and
    answers (`taken`, `answered`). An order that is not possible is refused at once.

    Parameters
    ----------
    events : EventStream
        Receives the possible orders, the questions, and lines about orders and their outcome.
    clock : callable, optional
        Returns seconds. An order that waits longer than `LIFE_S` is discarded.

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
        # Pending orders with the time of each (s)
        self._waiting: deque[tuple[float, WatchersOrder]] = deque()
        self._question = Asked("")
        self._answer: tuple[float, str] | None = None

    # The watcher calls these methods.

    def take(
        self,
        system_ids: Collection[int],
        order: str,
        value: str = "",
        confirmed: bool = False,
        *,
        age_s: float = 0.0,
    ) -> str:
        """Queue an order; return why it is refused, or an empty text if it is accepted.

        Parameters
        ----------
        system_ids : collection of int
            System ids of the addressed vehicles; ids that are not flying are ignored.
        order, value : str
            An order that is possible now, and its value: the height above home (m) for a takeoff, the item
            number from 1 for "set item".
        confirmed : bool
            Whether the watcher confirmed that motors start, or that several vehicles return or land.
        age_s : float
            Age of the order (s).
        """
        with self._lock:
            if order not in self._orders:
                return f"{one_line(order, 40)!r} cannot be ordered now"
            if self._vehicles.isdisjoint(system_ids):
                named = ", ".join(map(str, sorted(system_ids)[:3])) or "named"
                return f"there is no vehicle {named} to take the order"
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
        """Take an answer to the question numbered `question`; return why it is refused, or an empty text."""
        with self._lock:
            if question != self._question.number:
                return "the question has changed: look at the page"
            if text not in self._question.answers:
                known = " or ".join(self._question.answers)
                return f"{one_line(text, 40)!r} is not a valid answer" + f": give {known}" * bool(known)
            if refused := too_late(age_s):
                return refused
            self._answer = self._clock() - age_s, text
        return ""

    # The flight calls these methods.

    def allow(self, orders: Collection[str], vehicles: Collection[int]) -> None:
        """Set the orders that are possible now, and the system ids of the vehicles that may get them."""
        with self._lock:
            changed = self._orders != tuple(orders)
            self._orders, self._vehicles = tuple(orders), frozenset(vehicles)
            if not self._orders:
                # An order that came too late for one flight must not reach the next flight.
                self._waiting.clear()
        if changed:
            self._events.tell(Orderable(tuple(orders)))

    @property
    def waits(self) -> bool:
        """Whether an order is pending."""
        return bool(self._waiting)

    def taken(self) -> list[WatchersOrder]:
        """Return the pending orders; discard those older than `LIFE_S` with a warning."""
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
        """Ask a question with these possible answers in place of the last question; "" withdraws it."""
        with self._lock:
            asked = Asked(question, tuple(answers), self._question.number + 1)
            changed = self._question != asked
            if changed:
                self._question, self._answer = asked, None
        if changed:
            self._events.tell(asked)

    def answered(self) -> str | None:
        """Return the answer, or None; an answer older than `LIFE_S` is discarded with a warning."""
        with self._lock:
            answer, self._answer = self._answer, None
        if answer is None:
            return None
        given_s, text = answer
        if refused := too_late(self._clock() - given_s):
            self.warn(f"answered by the page: {text}: {refused}")
            return None
        return text
