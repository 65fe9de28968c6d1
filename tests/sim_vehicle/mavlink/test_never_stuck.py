"""A mission changed at any instant leaves no vehicle stuck: it is flown to its end, or held as told."""

from changed_missions import ON_THE_WAY_S, RTL, TAKEOFF, Flight, do, shots, speed, wp
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.execution.state import FlightPhase

SHORT = (TAKEOFF, speed(7.0), shots(5.0), wp(0, 20), wp(20, 20), do(177, 3.0, 1.0), wp(20, 0, 30.0), RTL)
POSITIONS = st.tuples(st.integers(-40, 40), st.integers(-40, 40), st.sampled_from([8.0, 20.0, 35.0]))
ITEMS = st.lists(
    st.one_of(
        st.builds(lambda place: wp(*place), POSITIONS),
        st.builds(speed, st.sampled_from([3.0, 7.0])),
        st.builds(shots, st.sampled_from([0.0, 4.0])),
        st.builds(lambda hold: do(93, hold), st.sampled_from([0.0, 2.0])),
    ),
    max_size=8,
)


def is_at_its_end(flight):
    """On the ground and disarmed, or at rest after the last item, or holding without a mission."""
    pilot = flight.pilot
    if not pilot.armed:
        return True
    waits = pilot.mission.complete or (flight.mode is Mode.HOLD and not pilot.mission.items)
    return waits and pilot.state.phase is FlightPhase.HOLD and flight.speed < 0.2


@sweep(few=8, many=60)
@given(
    st.sampled_from([PX4, ARDUPILOT]),
    st.sampled_from([None, "generic"]),
    st.floats(0.5, 45.0),
    ITEMS,
    st.booleans(),
    st.sampled_from([None, 0, 2, 4]),
    st.sampled_from(["whole", "slow", "broken", "cleared"]),
)
def test_never_stuck(autopilot, dynamics, when_s, items, starts, marked, how):
    flight = Flight(autopilot, dynamics=dynamics, items=SHORT).fly()
    flight.wait(when_s)
    items = (*((TAKEOFF,) if starts else ()), *items, RTL)
    marked = None if marked is None else min(marked, len(items) - 1)
    if how == "cleared":
        flight.tell(m.MAVLink_mission_clear_all_message(1, 1, 0))
    else:
        stop = len(items) // 2 + 1 if how == "broken" else None
        flight.upload(items, marked=marked, every_s=0.15 if how == "slow" else 0.0, stop_after=stop)
    flight.wait(400.0, lambda: is_at_its_end(flight), ON_THE_WAY_S)
    assert is_at_its_end(flight), (flight.mode, flight.pilot.state.phase, flight.place, flight.texts())
