"""Sans-IO state machines of the MAVLink mission protocol, for ground station and vehicle."""

from typing import TYPE_CHECKING

from geo.imports import attach

if TYPE_CHECKING:
    from mission.autopilots.dialect import Severity as Severity
    from mission.transfer.client import ClientTimers as ClientTimers
    from mission.transfer.client import ClientTransfer as ClientTransfer
    from mission.transfer.download import MissionDownload as MissionDownload
    from mission.transfer.events import ClearComplete as ClearComplete
    from mission.transfer.events import DownloadComplete as DownloadComplete
    from mission.transfer.events import Event as Event
    from mission.transfer.events import FailureReason as FailureReason
    from mission.transfer.events import LocalTransferError as LocalTransferError
    from mission.transfer.events import Output as Output
    from mission.transfer.events import PlanCleared as PlanCleared
    from mission.transfer.events import PlanReplaced as PlanReplaced
    from mission.transfer.events import PlanSent as PlanSent
    from mission.transfer.events import PlanState as PlanState
    from mission.transfer.events import Progress as Progress
    from mission.transfer.events import RemoteTransferError as RemoteTransferError
    from mission.transfer.events import StatusText as StatusText
    from mission.transfer.events import Transfer as Transfer
    from mission.transfer.events import TransferFailed as TransferFailed
    from mission.transfer.events import TransferStarted as TransferStarted
    from mission.transfer.events import TransferStatistics as TransferStatistics
    from mission.transfer.events import UploadBegunAnew as UploadBegunAnew
    from mission.transfer.events import UploadComplete as UploadComplete
    from mission.transfer.events import UploadVerified as UploadVerified
    from mission.transfer.remarks import Remark as Remark
    from mission.transfer.remarks import count_warning as count_warning
    from mission.transfer.rendering import Rendered as Rendered
    from mission.transfer.rendering import refuse_errors as refuse_errors
    from mission.transfer.rendering import render as render
    from mission.transfer.round_trip import RoundTrip as RoundTrip
    from mission.transfer.server import MissionServer as MissionServer
    from mission.transfer.server_session import StoredPlan as StoredPlan
    from mission.transfer.upload import NO_MISSION_LEFT as NO_MISSION_LEFT
    from mission.transfer.upload import MissionClear as MissionClear
    from mission.transfer.upload import MissionUpload as MissionUpload
    from mission.transfer.upload import check_plan as check_plan
    from mission.transfer.upload import gives_up_mission as gives_up_mission
    from mission.transfer.verified import OWN_TRANSFERS as OWN_TRANSFERS
    from mission.transfer.verified import Difference as Difference
    from mission.transfer.verified import TransferMaker as TransferMaker
    from mission.transfer.verified import VerifiedUpload as VerifiedUpload
    from mission.transfer.verified import compare_plans as compare_plans
    from mission.transfer.wire import CLIENT_MESSAGES as CLIENT_MESSAGES
    from mission.transfer.wire import SERVER_MESSAGES as SERVER_MESSAGES
    from mission.transfer.wire import item_from_message as item_from_message
    from mission.transfer.wire import item_to_message as item_to_message
    from mission.transfer.wire import plan_checksum as plan_checksum
    from mission.transfer.wire import result_text as result_text
else:
    __getattr__, __dir__, __all__ = attach(__name__)
