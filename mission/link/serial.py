"""A link over a serial line: a telemetry radio, or the USB port of an autopilot."""

from __future__ import annotations

import contextlib
import errno
import os
from typing import Any

from geo.imports import load_extra
from geo.texts import one_line
from mission.errors import LinkError, LinkLostError
from mission.link.address import LinkAddress
from mission.link.sockets import Stream

_WHY = {
    errno.ENOENT: "there is none of that name; check the name, and that it is plugged in",
    errno.EACCES: "permission denied; add yourself to the group that it belongs to (dialout, uucp)",
    errno.EBUSY: "another program uses it; end that",
    errno.EAGAIN: "another program uses it; end that",
    errno.ENOTTY: "it is no serial device; check the name",
}
_BACKLOG_BYTES = 1 << 16
_READ_BYTES = 65536


class SerialLink(Stream):
    """A serial line, never blocking; it keeps up to 64 KiB.

    LinkError if pyserial is not installed or the device cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(str(address), _BACKLOG_BYTES)
        serial = load_extra("serial", "serial", f"{self.name}: serial lines need", LinkError)
        try:
            self._port: Any = serial.Serial(
                address.host, address.port, timeout=0, write_timeout=0, exclusive=True
            )
        except (OSError, ValueError) as error:
            msg = f"{self.name}: the device cannot be opened: {_reason(error)}"
            raise LinkError(msg) from error

    def _write(self, data: bytearray) -> int:
        # pyserial's own write waits for a line that takes nothing, whatever its time-out.
        return os.write(self._port.fileno(), data)

    def _gone(self) -> LinkLostError:
        return LinkLostError(f"{self.name}: the device has gone; plug it in and start again")

    def receive(self) -> list[bytes]:
        """Return the bytes that have arrived; LinkError once the device has gone."""
        self._flush()
        try:
            data = self._port.read(_READ_BYTES)
        except (OSError, TypeError) as error:
            raise self._gone() from error
        return [data] if data else []

    def close(self) -> None:
        """Close the line."""
        with contextlib.suppress(OSError):
            self._port.close()

    def fileno(self) -> int | None:
        """Return the descriptor, None once closed."""
        return int(self._port.fileno()) if self._port.is_open else None


def _reason(error: BaseException) -> str:
    """Return why a device cannot be opened, and what to do; pyserial wraps what the system says in texts."""
    told: BaseException | None = error
    while told is not None:
        number = getattr(told, "errno", None)
        if number is None and told.args and isinstance(told.args[0], int):  # termios.error
            number = told.args[0]
        if number is not None:
            why = _WHY.get(number) or f"{os.strerror(number).lower()}; check its name"
            return one_line(why)
        told = told.__context__
    return one_line(f"{error}; check its name and its speed")


__all__ = ["SerialLink"]
