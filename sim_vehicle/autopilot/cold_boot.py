"""How an autopilot comes up: what it tells, and why it does not arm yet, from its start on."""

from __future__ import annotations

from dataclasses import dataclass

from sim_vehicle.autopilot.modes import Mode

__all__ = ["BootStage", "ColdBoot"]


@dataclass(frozen=True, slots=True)
class BootStage:
    """One stage of a boot, which lasts until the next."""

    begins_s: float
    """Since the autopilot's start."""
    problem: str = ""
    """Why it does not arm, in any mode; empty for nothing."""
    fix: int = 0
    """GPS_FIX_TYPE."""
    tells_place: bool = False
    """GLOBAL_POSITION_INT tells where it is; latitude and longitude are 0 otherwise."""
    knows_position: bool = False
    """The estimator has a position."""
    untold: frozenset[int] = frozenset()
    """Messages that are not sent yet."""
    text: str = ""
    """What is said when it begins."""


@dataclass(frozen=True, slots=True)
class ColdBoot:
    """The stages of a boot, the last of which is that of a vehicle that is ready."""

    stages: tuple[BootStage, ...]
    blind_flags: int
    """EKF_STATUS_FLAGS before it has a position."""
    blind_modes: frozenset[Mode]
    """Modes in which it arms without a position."""
    no_position: str
    """Why it does not arm in the others."""

    def at(self, boot_s: float) -> BootStage:
        """Return the stage at a time since the start."""
        return [one for one in self.stages if one.begins_s <= max(boot_s, 0.0)][-1]

    def problem(self, stage: BootStage, mode: Mode) -> str | None:
        """Return why a vehicle does not arm in a mode; None when nothing of the boot is in the way."""
        blind = not stage.knows_position and mode not in self.blind_modes
        return stage.problem or (self.no_position if blind else None)
