"""Hosts of a run's flights: a simulation of vehicles, cameras and stations, or links to real vehicles."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

from numpy.random import SeedSequence

from mission.ground.arming_gate import ArmingGate
from mission.link.codec.dialect import Message
from mission.link.tlog import FrameSink
from mission.model import GeoPoint
from mission.transfer import OWN_TRANSFERS, TransferMaker
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.component import NEVER, Component
from sim_vehicle.execution.state import EPOCH_UNIX_S
from sim_vehicle.host.injection import AnyFault
from sim_vehicle.host.router import RadioRange
from sim_vehicle.host.simulation import Impairment, Simulation, StopReason
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.planning import home_of
from wbf_mission.run.orders import Orders
from wbf_mission.run.sortie import Sortie


class FlightHost(Protocol):
    """Host of one flight: runs the flight's components by the host's clock."""

    @property
    def now_s(self) -> float:
        """Seconds since the host was opened."""

    @property
    def frames(self) -> int:
        """Number of MAVLink frames sent."""

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Advance time until a condition holds, but by at most `limit_s` seconds."""

    def send(self, component: Component, messages: Iterable[Message]) -> None:
        """Send messages from a component at the current time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hosting(ABC):
    """Options of a run's flights, and maker of their hosts: a simulation, or links to real vehicles."""

    pace: float | None = None  # Seconds of the host's clock per wall second; None: no fixed pace.
    tlog: Path | None = None  # File for all MAVLink frames; the first flight makes its folder.
    orders: Orders | None = None  # Orders of a watcher, or None if orders are not possible.
    force: bool = False  # Whether to upload plans that the autopilot would refuse or not fly.
    waits_for_decisions: ClassVar[bool] = True  # Whether simulated time stops while a policy decides.

    @property
    def transfers(self) -> TransferMaker:
        """Maker of the mission transfers."""
        return OWN_TRANSFERS

    def arming_gate(self, system_id: int) -> ArmingGate | None:  # noqa: ARG002
        """Return the gate that holds back a vehicle's arming, or None if nothing holds it back."""
        return None

    @abstractmethod
    def open(
        self,
        sorties: Sequence[Sortie],
        writer: FrameSink | None,
        *,
        offset_s: float,
        seed: SeedSequence,
        gone: Collection[int],
    ) -> AbstractContextManager[FlightHost]:
        """Return the host of the next flight.

        Parameters
        ----------
        sorties : sequence of Sortie
        writer : FrameSink or None
            Receives every frame.
        offset_s : float
            Start of the flight, seconds after the start of the run.
        seed : SeedSequence
            Seed of the faults.
        gone : collection of int
            System ids of the lost vehicles.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualHosting(Hosting):
    """Simulated vehicles on a virtual clock, which runs as fast as possible unless a pace is given."""

    impairment: Impairment | None = None  # Disturbances of the radio link.
    faults: tuple[AnyFault, ...] = ()  # Faults injected into each flight, except faults of lost vehicles.

    def open(
        self,
        sorties: Sequence[Sortie],
        writer: FrameSink | None,
        *,
        offset_s: float,
        seed: SeedSequence,
        gone: Collection[int],
    ) -> AbstractContextManager[FlightHost]:
        """Return a simulation of the vehicles with their cameras and ground stations."""
        aboard = [_aboard(sortie) for sortie in sorties]
        simulation = Simulation(
            [part for on, sortie in zip(aboard, sorties, strict=True) for part in (*on, sortie.ground)],
            tap=tap_of(writer, (EPOCH_UNIX_S + offset_s).__add__),
            impairment=self.impairment,
            faults=[fault for fault in self.faults if fault.vehicle not in gone],
            seed=seed,
            remote=[sortie.ground for sortie in sorties],
            radio_range=_radio_range(sorties, [vehicle for vehicle, _ in aboard]),
        )
        return nullcontext(simulation)


def _radio_range(sorties: Sequence[Sortie], vehicles: Sequence[SimVehicle]) -> RadioRange | None:
    """Return the radio range around the farm's home, where all ground stations stand."""
    range_m, farm = sorties[0].vehicle.vehicle.radio_range_m, sorties[0].plan.farm
    if range_m is None:
        return None
    latitude_deg, longitude_deg = farm.frame.to_wgs84(*farm.home_m)
    return RadioRange(range_m, GeoPoint(latitude_deg, longitude_deg, farm.frame.altitude_m), vehicles)


def _aboard(sortie: Sortie) -> tuple[SimVehicle, LeafCameraComponent]:
    """Return the simulated vehicle of a sortie, and its camera."""
    plan, one, number = sortie.plan, sortie.vehicle, sortie.number
    vehicle = SimVehicle(
        plan.vehicle,
        home_of(plan.mission, plan.farm),
        wind=one.wind(number),
        autopilot=get_autopilot(one.vehicle.autopilot),
        system_id=number.system_id,
        epoch_unix_s=EPOCH_UNIX_S,
        noise=one.noise(number),
        sd_card=True,
    )
    camera = LeafCameraComponent(
        sortie.leaf_camera,
        plan.farm,
        system_id=number.system_id,
        position_error=vehicle.position_error if vehicle.errors else None,
        looks=vehicle.camera_attitude,
    )
    return vehicle, camera


def tap_of(
    writer: FrameSink | None, time_of: Callable[[float], float]
) -> Callable[[bytes, float], None] | None:
    """Return a function that writes each frame with its Unix time, or None without a writer."""
    if writer is None:
        return None
    write = writer.write

    def tap(frame: bytes, now_s: float) -> None:
        write(frame, time_of(now_s))

    return tap
