"""A clock that servers of one process share: it goes on to the next deadline when all of them only wait."""

import contextlib
import select
import threading
import time

from mission.transfer.driver import TransferDriver

LONG_S = 60.0  # a limit against hanging, not a measure
_LEAST_S = 1e-6  # more than rounding: a deadline that is due is past after a wait


class SharedClock:
    """Real time at first; while a leader takes part, it stands as long as any of the servers has work to do.

    A server that sends is still at work, and what it sends is there when the others look again: the clock
    goes on only after all have looked and found nothing since. So a busy machine makes tests slow, but it
    does not make their servers late.
    """

    def __init__(self):
        self._changed = threading.Condition()
        self._now_s, self._real_s, self._leaders = 0.0, time.monotonic(), 0
        self._until_s, self._looked, self._count = {}, {}, 0

    def now(self):
        """Return the time in seconds."""
        with self._changed:
            return self._now()

    def _now(self):
        real_s = time.monotonic()
        if not self._leaders:
            self._now_s += real_s - self._real_s
        self._real_s = real_s
        return self._now_s

    @contextlib.contextmanager
    def led(self):
        """The clock waits for its servers in this block."""
        self._lead(1)
        try:
            yield
        finally:
            self._lead(-1)

    def _lead(self, more):
        with self._changed:
            self._now()
            self._leaders += more
            self._changed.notify_all()

    @contextlib.contextmanager
    def taking_part(self, server):
        """A server runs in this block."""
        with self._changed:
            self._until_s[server] = None
        try:
            yield
        finally:
            with self._changed:
                del self._until_s[server]
                self._looked.pop(server, None)
                self._count += 1  # The others may be at rest without it.
                self._changed.notify_all()

    def wait(self, server, look, seconds):
        """Wait like ``look(seconds)``, by this clock; `look` returns what arrived."""
        with self._changed:
            until_s = self._now() + max(_LEAST_S, seconds)
            self._count += 1  # It may have sent something to the others.
            self._until_s[server] = until_s
            self._changed.notify_all()
        try:
            while True:
                with self._changed:
                    count, left_s, led = self._count, until_s - self._now(), bool(self._leaders)
                found = look(0.0 if led else left_s)
                if found or not led:
                    return found
                with self._changed:
                    self._looked[server] = count
                    if self._count == count and all(self._rests(each) for each in self._until_s):
                        self._now_s = max(self._now_s, min(self._until_s.values()))
                        self._count += 1
                        self._changed.notify_all()
                    while self._leaders and self._count == count:
                        assert self._changed.wait(LONG_S), "a server does not come to rest"
                    if until_s <= self._now():
                        return found
        finally:
            with self._changed:
                self._until_s[server] = None

    def _rests(self, server):
        """Whether a server waits, and has looked since anybody may have sent something."""
        return self._until_s[server] is not None and self._looked.get(server) == self._count


def sharing(kind, clock, *, leads=False):
    """Return a kind of `Server` by the time of a shared clock; one that leads has it wait for all."""

    class Sharing(kind):
        def __init__(self, *given, **options):
            super().__init__(*given, **options)
            look = self._selector.wait
            self._selector.wait = lambda seconds: clock.wait(self, look, seconds)

        def _wall_s(self):
            return clock.now() * self.speed

        def run(self, *given, **options):
            with clock.led() if leads else contextlib.nullcontext(), clock.taking_part(self):
                return super().run(*given, **options)

    return Sharing


def leading_driver(clock):
    """Return a `TransferDriver` by the time of a shared clock, which waits for it while it is open."""

    class LeadingDriver(TransferDriver):
        def __init__(self, endpoint, **options):
            self._part = contextlib.ExitStack()
            self._part.enter_context(clock.led())
            self._part.enter_context(clock.taking_part(self))
            super().__init__(endpoint, clock=clock.now, wait=self._look, **options)

        def _look(self, link, seconds):
            clock.wait(self, lambda left_s: select.select([link.fileno()], [], [], left_s)[0], seconds)

        def close(self):
            self._part.close()
            super().close()

    return LeadingDriver
