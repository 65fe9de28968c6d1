"""Clearing a plan, the ground station's side, sans-IO."""

# ruff: noqa: ARG002 - the actions of the transition table share one signature

from __future__ import annotations

from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import is_a
from mission.transfer import wire
from mission.transfer.client import ClientTransfer
from mission.transfer.client_table import ClientInput
from mission.transfer.events import ClearComplete, Output, PlanState


class MissionClear(ClientTransfer):
    """Empties one plan; ends with `ClearComplete` or `TransferFailed`.

    Parameters
    ----------
    mission_type : MissionType
        Which plan.
    **options
        See `mission.transfer.client.ClientTransfer`.
    """

    _opening_input = ClientInput.START_CLEAR

    def _item_count(self) -> int:
        return 0

    def _opening(self) -> Message:
        return wire.clear_all(self.target, self.mission_type)

    def _judge(self, message: Message, now_s: float) -> ClientInput:
        if is_a(message, mavlink.MAVLink_mission_ack_message):
            return self._judge_ack(message, accepted=True)
        return ClientInput.STRAY

    def _complete(self, message: wire.AckMessage, now_s: float) -> Output:
        return Output(events=(ClearComplete(self.mission_type),))

    def _plan_state(self) -> PlanState:
        return PlanState.UNKNOWN if self._openings else PlanState.OLD
