"""Power and endurance over speed of the package's vehicles, beside what makers publish.

    python benchmarks/power_curves.py [--out docs/images/power_curves.png]

Prints the table of published and modelled flights, and draws the curves.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.power_spec import BatterySpec, PowerSpec
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.energy.endurance import endurance_s
from sim_vehicle.energy.power import flight_power_w

# What DJI publishes of one aircraft at several speeds; docs/energy.md has the sources. Mass (kg), propeller
# (inch), battery (Wh), nominal voltage of a cell, cells, and flights: speed (m/s), minutes until empty.
DRONES = {
    "Mavic 2": (0.907, 8.3, 59.29, 3.85, 4, ((0.0, 29.0), (25 / 3.6, 31.0), (50 / 3.6, 18.0 / 50 * 60))),
    "Mavic Pro": (0.734, 8.3, 43.6, 3.8, 3, ((0.0, 24.0), (25 / 3.6, 27.0))),
    "Mavic Pro Platinum": (0.734, 8.3, 43.6, 3.8, 3, ((0.0, 27.0), (25 / 3.6, 30.0))),
    "Mavic 3": (0.895, 9.4, 77.0, 3.85, 4, ((0.0, 40.0), (9.0, 46.0))),
}
DRAG_AREA_M2 = 0.03


def calibrated(name: str) -> VehicleSpec:
    """Return a drone whose blade drag is such that it hovers as long as published."""
    mass, inches, energy, cell_v, cells, flights = DRONES[name]
    disc = math.pi * (0.0254 * inches) ** 2
    vehicle = replace(
        get_vehicle("quad"),
        name=name,
        battery=BatterySpec(energy, cells, cell_v, full_cell_v=4.4),
        power=PowerSpec(
            mass_kg=mass, disc_area_m2=disc, tip_speed_m_s=60.0, drag_area_m2=DRAG_AREA_M2, avionics_w=6.0
        ),
    )
    low, high = 1e-3, 0.5
    for _ in range(50):
        middle = 0.5 * (low + high)
        assert isinstance(vehicle.power, PowerSpec)
        vehicle = replace(vehicle, power=replace(vehicle.power, blade_drag=middle))
        longer = endurance_s(vehicle, 0.0) > 60.0 * flights[0][1]
        low, high = (middle, high) if longer else (low, middle)
    return vehicle


def table() -> None:
    """Print published and modelled minutes."""
    print(f"{'aircraft':<20} {'m/s':>5} {'published':>10} {'model':>7} {'error':>7}")
    for name, numbers in DRONES.items():
        vehicle = calibrated(name)
        for speed, minutes in numbers[-1]:
            model = endurance_s(vehicle, speed) / 60.0
            note = "  (set)" if speed == 0.0 else ""
            _row(name, speed, minutes, model, note)
    for name in ("mini-quad", "quad", "wing"):
        vehicle = get_vehicle(name)
        told = vehicle.published
        assert told is not None
        model = endurance_s(vehicle, told.airspeed_m_s, used_fraction=told.used_fraction) / 60.0
        _row(name, told.airspeed_m_s, told.endurance_min, model)


def _row(name: str, speed: float, minutes: float, model: float, note: str = "") -> None:
    error = model / minutes - 1.0
    print(f"{name:<20} {speed:>5.1f} {minutes:>6.1f} min {model:>7.1f} {error:>+7.1%}{note}")


def draw(out: Path) -> None:
    """Draw power over airspeed."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(15.0, 4.6), constrained_layout=True)
    speeds = np.linspace(0.0, 16.0, 161)
    for colour, name in zip(("C0", "C1", "C2", "C3"), DRONES, strict=True):
        vehicle = calibrated(name)
        assert vehicle.power is not None
        assert vehicle.battery is not None
        hover = flight_power_w(vehicle.power, battery=vehicle.battery)
        curve = [flight_power_w(vehicle.power, v, battery=vehicle.battery) / hover for v in speeds]
        axes[0].plot(speeds, curve, color=colour, label=name)
        flights = DRONES[name][-1]
        points = [(speed, flights[0][1] / minutes) for speed, minutes in flights]
        axes[0].plot(*zip(*points, strict=True), "o", color=colour, markeredgecolor="black")
    axes[0].set(title="Model (lines) and published endurance (points)", ylabel="power over that of hovering")
    axes[0].set(ylim=(0.6, 2.0))
    for colour, name in (("C0", "quad"), ("C1", "mini-quad")):
        vehicle = get_vehicle(name)
        assert vehicle.power is not None
        for style, climb in (("-", 0.0), ("--", 2.0), (":", -2.0)):
            curve = [flight_power_w(vehicle.power, v, climb, battery=vehicle.battery) for v in speeds]
            label = f"{name}, {climb:+g} m/s" if climb else f"{name}, level"
            axes[1].plot(speeds, curve, style, color=colour, label=label)
    axes[1].set(
        title="Rotorcraft of the package: level, climbing, descending", ylabel="power (W)", ylim=(0.0, 320.0)
    )
    vehicle = get_vehicle("wing")
    assert vehicle.power is not None
    speeds = np.linspace(12.0, 25.0, 131)
    for style, load, climb in (("-", 1.0, 0.0), ("--", 1.0, 2.0), (":", 1.41, 0.0)):
        power = [
            flight_power_w(vehicle.power, v, climb, load_factor=load, battery=vehicle.battery) for v in speeds
        ]
        label = "turning at 45 degrees" if load > 1.0 else f"climbing {climb:g} m/s" if climb else "level"
        axes[2].plot(speeds, power, style, color="C2", label=label)
    axes[2].set(title="Fixed wing of the package (`wing`)", ylabel="power (W)", ylim=(0.0, None))
    for axis in axes:
        axis.set(xlabel="airspeed (m/s)")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=90)
    print(f"drawn: {out}")


def main() -> None:
    """Print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--out", type=Path, default=Path("docs/images/power_curves.png"))
    arguments = parser.parse_args()
    table()
    draw(arguments.out)


if __name__ == "__main__":
    main()
