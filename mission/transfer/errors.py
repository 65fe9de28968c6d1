"""Errors of mission transfers: ours and theirs.

::

    TransferError
    +-- LocalTransferError     this side was used wrongly; a mistake of the caller
    +-- RemoteTransferError    the other side refused, misbehaved or fell silent
        +-- NoVehicleError     no vehicle was heard at all
"""

from __future__ import annotations

from mission.errors import TransferError
from mission.transfer.events import TransferFailed


class LocalTransferError(TransferError):
    """A transfer that was started twice, with a plan that cannot be sent, or used after its end."""


class RemoteTransferError(TransferError):
    """A transfer that the vehicle refused, broke or did not answer; `failure` is the event that ended it."""

    def __init__(self, text: str, failure: TransferFailed | None = None) -> None:
        super().__init__(text)
        self.failure = failure


class NoVehicleError(RemoteTransferError):
    """No heartbeat of a vehicle was heard."""


__all__ = ["LocalTransferError", "NoVehicleError", "RemoteTransferError", "TransferError"]
