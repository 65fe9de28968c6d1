"""The MAVLink mission protocol as sans-IO state machines, both roles."""

from mission.transfer.clear import MissionClear
from mission.transfer.client import ClientTimers, ClientTransfer, RoundTrip
from mission.transfer.compare import Difference, compare_plans
from mission.transfer.download import MissionDownload
from mission.transfer.errors import LocalTransferError, RemoteTransferError
from mission.transfer.events import (
    ClearComplete,
    DownloadComplete,
    Event,
    FailureReason,
    Output,
    PlanCleared,
    PlanReplaced,
    PlanSent,
    PlanState,
    Progress,
    StatusText,
    TransferFailed,
    TransferStarted,
    TransferStatistics,
    UploadComplete,
    UploadVerified,
)
from mission.transfer.profile import ARDUPILOT, GENERIC, PX4, Profile, count_warning, profile_for
from mission.transfer.server import MissionServer, StoredPlan
from mission.transfer.upload import MissionUpload, check_plan
from mission.transfer.verified import VerifiedUpload
from mission.transfer.wire import (
    CLIENT_MESSAGES,
    SERVER_MESSAGES,
    item_from_message,
    item_to_message,
    plan_checksum,
    result_text,
)

__all__ = [
    "ARDUPILOT",
    "CLIENT_MESSAGES",
    "GENERIC",
    "PX4",
    "SERVER_MESSAGES",
    "ClearComplete",
    "ClientTimers",
    "ClientTransfer",
    "Difference",
    "DownloadComplete",
    "Event",
    "FailureReason",
    "LocalTransferError",
    "MissionClear",
    "MissionDownload",
    "MissionServer",
    "MissionUpload",
    "Output",
    "PlanCleared",
    "PlanReplaced",
    "PlanSent",
    "PlanState",
    "Profile",
    "Progress",
    "RemoteTransferError",
    "RoundTrip",
    "StatusText",
    "StoredPlan",
    "TransferFailed",
    "TransferStarted",
    "TransferStatistics",
    "UploadComplete",
    "UploadVerified",
    "VerifiedUpload",
    "check_plan",
    "compare_plans",
    "count_warning",
    "item_from_message",
    "item_to_message",
    "plan_checksum",
    "profile_for",
    "result_text",
]
