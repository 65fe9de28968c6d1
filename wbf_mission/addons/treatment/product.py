"""Treatment map as a product of a run (``fly --treatment-map``)."""

from __future__ import annotations

from pathlib import Path

from wbf_mission.addons.treatment.gis import UtmCells, require_gis
from wbf_mission.progress import Progress
from wbf_mission.run.record import RunRecord
from wbf_mission.scenario import Scenario


class _Treatment:
    needs_estimate = True

    def require(self, scenario: Scenario) -> None:
        require_gis()
        UtmCells.of(scenario.farm.load())

    def files(self, run: RunRecord) -> list[str]:
        return ["treatment"] if len(run.observations) else []

    def write(self, run: RunRecord, path: Path, progress: Progress) -> None:
        from wbf_mission.addons.treatment.flights import treatment_of_result
        from wbf_mission.addons.treatment.map_files import write_map

        write_map(treatment_of_result(run, source="this flight"), path, progress)


TREATMENT = _Treatment()
