"""Exceptions of mission transfers.

::

    TransferError
    +-- LocalTransferError     wrong use by the caller
    +-- RemoteTransferError    the vehicle refused, violated the protocol or did not answer
        +-- NoVehicleError     no vehicle heartbeat was received
"""

from __future__ import annotations

from mission.errors import TransferError
from mission.transfer.events import TransferFailed


class LocalTransferError(TransferError):
    """A transfer was started twice, used after its end, or given a plan that cannot be sent."""


class RemoteTransferError(TransferError):
    """The vehicle refused, violated the protocol or did not answer; ``failure`` is the last event."""

    def __init__(self, text: str, failure: TransferFailed | None = None) -> None:
        super().__init__(text)
        self.failure = failure


class NoVehicleError(RemoteTransferError):
    """No vehicle heartbeat was received."""


__all__ = ["LocalTransferError", "NoVehicleError", "RemoteTransferError", "TransferError"]
