"""Where `GridLimitedRandomness` was before version 0.2: installations made before name it so."""

from mission.policies.authors.grid_limited_randomness import GridLimitedRandomness as GridLimitedRandomness
