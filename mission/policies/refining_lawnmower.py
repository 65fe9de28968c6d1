"""Where `RefiningLawnmower` was before version 0.2: installations made before name it so."""

from mission.policies.authors.refining_lawnmower import RefiningLawnmower as RefiningLawnmower
