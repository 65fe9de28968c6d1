"""Which random streams the flights of a run draw from."""

import itertools

from wbf_mission import Scenario
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.run.resolve import resolve


def test_the_first_flight_has_the_parts_own_stream_and_no_two_flights_the_same():
    assert SortieNumber.first(6, 1).stream_names("wind") == ("wind",)
    assert SortieNumber.first(6, 3).stream_names("wind") == ("wind", "vehicle-3")
    names = [
        SortieNumber(day, flight, system_id, 6).stream_names("wind")
        for day, flight, system_id in itertools.product(range(6, 9), (1, 2), (1, 2))
    ]
    assert len(set(names)) == len(names)
    assert names[-1] == ("wind", "day-8", "flight-2", "vehicle-2")


def test_planning_alone_draws_what_the_first_flight_draws():
    for one in resolve(Scenario(farm="miniberry-10", vehicle="ideal", vehicles=2, day=4)).vehicles:
        task = one.task
        first = task.of_sortie(SortieNumber.first(4, task.system_id)).request.seed
        again = task.of_sortie(SortieNumber(4, 2, task.system_id, 4)).request.seed
        assert first.entropy == task.request.seed.entropy != again.entropy
