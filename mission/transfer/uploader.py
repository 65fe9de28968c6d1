"""Who carries plans between us and a vehicle: our own state machines, or something with the same face."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from mission.link.codec.dialect import Message
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer.download import MissionDownload
from mission.transfer.events import Output, TransferStatistics
from mission.transfer.verified import VerifiedUpload

__all__ = ["OWN_TRANSFERS", "OwnTransfers", "Transfer", "TransferMaker", "Upload"]


class Transfer(Protocol):
    """What can be run: uploads, downloads, clears, verified uploads. It ends with one event, see `Output`."""

    @property
    def done(self) -> bool:
        """Whether it is over."""

    def start(self, now_s: float) -> Output:
        """Begin."""

    def receive(self, message: Message, now_s: float) -> Output:
        """Take one message."""

    def poll(self, now_s: float) -> Output:
        """Act on timers."""

    def next_deadline(self) -> float | None:
        """When to poll."""

    def cancel(self, now_s: float) -> Output:
        """Break off."""

    def statistics(self, now_s: float | None = None) -> TransferStatistics:
        """What it has cost."""


class Upload(Transfer, Protocol):
    """An upload that is read back: it ends with `UploadVerified` or `TransferFailed`."""

    @property
    def confirmed_s(self) -> float | None:
        """When the vehicle confirmed the plan; None before."""

    @property
    def opaque_id(self) -> int:
        """The plan's id, as the vehicle confirmed it; 0 for none."""


class TransferMaker(Protocol):
    """Makes transfers with a vehicle."""

    def upload(
        self,
        items: Sequence[MissionItem],
        mission_type: MissionType,
        *,
        home: GeoPoint | None = None,
        start_sequence: int | None = 0,
        **options: Any,
    ) -> Upload:
        """Return an upload of a plan that is read back.

        Parameters and errors are those of `MissionUpload`; a maker uses the options that it knows.
        """

    def download(self, mission_type: MissionType, **options: Any) -> Transfer:
        """Return a reading of a plan; it ends with `DownloadComplete` or `TransferFailed`."""


class OwnTransfers:
    """Transfers by our own state machines."""

    def upload(
        self,
        items: Sequence[MissionItem],
        mission_type: MissionType,
        *,
        home: GeoPoint | None = None,
        start_sequence: int | None = 0,
        **options: Any,
    ) -> VerifiedUpload:
        """Return an upload; see `TransferMaker`."""
        return VerifiedUpload(items, mission_type, home=home, start_sequence=start_sequence, **options)

    def download(self, mission_type: MissionType, **options: Any) -> MissionDownload:
        """Return a reading; see `TransferMaker`."""
        return MissionDownload(mission_type, **options)


OWN_TRANSFERS = OwnTransfers()
"""The one that is used unless another is given."""
