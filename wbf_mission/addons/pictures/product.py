"""Pictures as a product of a run (``fly --plots``)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mission.ground.tracks import joined
from wbf_mission.addons.pictures.path_plot import plot_run
from wbf_mission.addons.pictures.sheets import plot_farm, plot_field, plot_score
from wbf_mission.progress import Progress
from wbf_mission.run.record import RunRecord
from wbf_mission.scenario import Scenario


class _Pictures:
    needs_estimate = True
    plot_farm = staticmethod(plot_farm)  # For ``farm draw``
    plot_run = staticmethod(plot_run)  # For `wbf_mission.Result.plot`

    def require(self, scenario: Scenario) -> None:
        pass

    def files(self, run: RunRecord) -> list[str]:
        fields = [f"field_{estimate.field.name}.png" for estimate in run.maps]
        return ["path.png", *fields, *(["score.png"] if fields and len(run.history.times_s) else [])]

    def write(self, run: RunRecord, path: Path, progress: Progress) -> None:  # noqa: ARG002
        farm = run.farm
        if path.name == "path.png":
            plot_run(run, path)
        elif path.name == "score.png":
            title = f"{farm.name}: {run.plan.planner or 'mission file'}, {run.plan.vehicle.name}"
            plot_score(run.history, path, f"{title}, {run.estimator}", run.fields)
        else:
            day = run.days[-1].day if run.days else run.scenario.farm.day
            tracks = [flight.track for flight in run.flights if flight.day == day]
            last = joined(tracks or [run.flights[-1].track])
            number = self.files(run).index(path.name) - 1
            plot_field(
                farm,
                run.maps[number],
                path,
                truth=run.true_maps[number],
                flown_m=np.column_stack((last.x_m, last.y_m)),
                about=f"{farm.name}, day {day}, {run.estimator}",
            )


PICTURES = _Pictures()
