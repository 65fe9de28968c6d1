"""Where `adaptive_lawnmower` was before version 0.2: installations made before name it so."""

from mission.planners.lawnmower import adaptive_lawnmower as adaptive_lawnmower
