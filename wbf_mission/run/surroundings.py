"""What surrounds the vehicles of a run: its environment, and what the leaf cameras make of it."""

from __future__ import annotations

from geo import Farm
from geo.seeds import child_seed
from sensors.camera.leaf_camera import LeafCameraOptions
from sensors.environment import Environment
from sensors.environment.cache import EnvironmentCache
from sensors.environment.memory import EnvironmentMemory
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from wbf_mission.progress import Progress
from wbf_mission.scenario import CameraOptions, Scenario


def make_environment(
    scenario: Scenario, farm: Farm, progress: Progress | None = None, *, use_cache: bool = True
) -> Environment:
    """Return the environment of the scenario's seed on its days; large ones are kept in the user's cache."""
    days = scenario.farm.day, scenario.farm.day + scenario.farm.days - 1
    fields = load_field_set(scenario.farm.fields)
    return environment_of(farm, fields, days, scenario.seed, progress, use_cache=use_cache)[0]


def environment_of(
    farm: Farm,
    fields: FieldSet,
    days: tuple[int, int],
    seed: int,
    progress: Progress | None,
    *,
    use_cache: bool,
    memory: EnvironmentMemory | None = None,
) -> tuple[Environment, bool]:
    """Return the environment of a run's seed from its first to its last day, and whether the cache had it.

    It may be one that other runs with the memory had.
    """

    def tell(done: int, total: int) -> None:
        if progress is not None:
            progress("environment", done, total)

    cache = EnvironmentCache.of_user() if use_cache else EnvironmentCache.off()
    memory = EnvironmentMemory() if memory is None else memory
    return memory.environment(
        cache,
        farm.grid(),
        day=days[0],
        last_day=days[1],
        seed=child_seed(seed, "environment"),
        fields=fields,
        progress=tell,
    )


def camera_options(camera: CameraOptions, fields: FieldSet) -> LeafCameraOptions:
    """Return the leaf camera's own options, on a farm with these fields."""
    return LeafCameraOptions(
        footprint_cells=camera.footprint,
        noise_std=camera.noise,
        false_positive_rate=camera.false_positive_rate,
        false_negative_rate=camera.false_negative_rate,
        sensed=camera.fields,
        fields=fields,
    )
