"""Hosting of flights of vehicles behind links, in real time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from geo.system import steady_s
from mission.ground.arming_gate import ArmingGate
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import FrameSink
from mission.transfer import TransferMaker
from sim_vehicle.camera.component import LeafCameraComponent
from wbf_mission.addons.base.links import Heard, LinkHost, Note, Via
from wbf_mission.addons.operate.riding_camera import RidingCamera
from wbf_mission.run.hosting import Hosting, tap_of
from wbf_mission.run.sortie import Sortie

__all__ = ["LinkHosting", "riding_camera"]

_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkHosting(Hosting):
    """Hosting of vehicles behind links: this program is their ground stations and leaf cameras."""

    heard: Sequence[Heard]
    agreed: bool  # Whether the operator confirmed the start in advance
    note: Note  # Receives lines for the operator
    via: Via
    waits_for_decisions: ClassVar[bool] = False

    @property
    def transfers(self) -> TransferMaker:
        """Makes the mission transfers."""
        return self.via.transfers

    def arming_gate(self, system_id: int) -> ArmingGate:
        """Return the gate before arming: the vehicle's pre-arm checks and the operator's confirmation."""
        return ArmingGate((system_id, _AUTOPILOT), agreed=self.agreed, clock=steady_s)

    def open(
        self,
        sorties: Sequence[Sortie],
        writer: FrameSink | None,
        **_of_a_simulation: object,
    ) -> LinkHost:
        """Open the links; LinkError if an address is wrong, in use or unreachable."""
        cameras = [riding_camera(sortie) for sortie in sorties]
        tap = tap_of(writer, lambda _now_s: time.time())
        return self.via.serve(self.heard, cameras, [sortie.ground for sortie in sorties], tap, self.note)


def riding_camera(sortie: Sortie) -> RidingCamera:
    """Return the leaf camera that follows the telemetry of a sortie's vehicle."""
    camera = LeafCameraComponent(sortie.leaf_camera, sortie.plan.farm, system_id=sortie.system_id)
    riding = RidingCamera(camera, sortie.held_mission, sortie.is_changing, sortie.follow)
    sortie.images_missed = lambda: riding.missed
    return riding
