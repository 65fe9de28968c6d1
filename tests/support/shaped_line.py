"""A radio on a serial line: two pseudo terminals, and between them a rate, a small buffer, delay and loss."""

import contextlib
import os
import pty
import random
import select
import time
import tty
from collections import deque
from pathlib import Path

from in_a_thread import InAThread

from mission.link.codec.frames import FrameReader

_BITS_A_BYTE = 10.0


class _Way:
    """One direction: whole frames, as a radio sends them; what does not fit the buffer is lost."""

    def __init__(self, source, sink, *, baud, buffer_bytes, delay_s, loss, seed):
        self.source, self.sink = source, sink
        self._rate = baud / _BITS_A_BYTE
        self._buffer_bytes, self._delay_s, self._loss = buffer_bytes, delay_s, loss
        self._luck = random.Random(seed)
        self._frames = []
        self._reader = FrameReader(wanted=(), tap=self._frames.append)
        self._flying = deque()
        self._free_s = 0.0
        self.offered = self.carried = self.overrun = 0

    def take(self, now_s):
        with contextlib.suppress(OSError):
            self._reader.feed(os.read(self.source, 65536))
        for frame in self._frames:
            self.offered += len(frame)
            begin_s = max(now_s, self._free_s)
            if (begin_s - now_s) * self._rate + len(frame) > self._buffer_bytes:
                self.overrun += len(frame)
                continue
            self._free_s = begin_s + len(frame) / self._rate
            if self._luck.random() >= self._loss:
                self._flying.append((self._free_s + self._delay_s, frame))
        self._frames.clear()

    def deliver(self, now_s):
        while self._flying and self._flying[0][0] <= now_s:
            _, frame = self._flying.popleft()
            self.carried += len(frame)
            with contextlib.suppress(OSError):
                os.write(self.sink, frame)

    @property
    def next_s(self):
        return self._flying[0][0] if self._flying else float("inf")


class ShapedLine(InAThread):
    """Two devices joined by a bad radio, shaped in a thread.

    Attributes
    ----------
    devices : tuple of str
        Of the vehicle and of the ground station: names that stay when the device behind them is another.
    up, down : _Way
        To the vehicle, and from it.
    """

    def __init__(self, folder, *, baud=57600, buffer_bytes=2048, delay_s=0.0, loss=0.0, seed=1):
        shape = {"baud": baud, "buffer_bytes": buffer_bytes, "delay_s": delay_s, "loss": loss}
        self.devices = (str(folder / "vehicle.tty"), str(folder / "ground.tty"))
        self._ends = {}
        for device in self.devices:
            self._plug(device)
        near, far = (self._ends[device][0] for device in self.devices)
        self.down = _Way(near, far, seed=seed, **shape)
        self.up = _Way(far, near, seed=seed + 1, **shape)
        super().__init__()

    def _plug(self, device):
        near, far = pty.openpty()
        tty.setraw(near)
        tty.setraw(far)
        os.set_blocking(near, False)
        Path(device).symlink_to(os.ttyname(far))
        self._ends[device] = (near, far)

    def unplug_ground(self):
        """Let the device of the ground station disappear."""
        device = self.devices[1]
        with self._lock:
            Path(device).unlink()
            for end in self._ends.pop(device):
                os.close(end)
            self.up.source = self.down.sink = -1

    def plug_ground(self):
        """Let it appear again, as another device of the same name."""
        device = self.devices[1]
        with self._lock:
            self._plug(device)
            self.up.source = self.down.sink = self._ends[device][0]

    def _run(self):
        while not self._stopping.is_set():
            with self._lock:
                now_s = time.monotonic()
                for way in (self.up, self.down):
                    way.take(now_s)
                    way.deliver(now_s)
                sources = [way.source for way in (self.up, self.down) if way.source >= 0]
                wait_s = min(max(min(self.up.next_s, self.down.next_s) - now_s, 0.0), 0.05)
            with contextlib.suppress(OSError, ValueError):
                select.select(sources, [], [], min(wait_s, 0.01))
            time.sleep(0.002)

    def _close(self):
        for end in sum(self._ends.values(), ()):
            os.close(end)
