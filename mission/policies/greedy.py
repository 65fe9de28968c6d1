"""Where `Greedy` was before version 0.2: installations made before name it so."""

from mission.policies.map_policies import Greedy as Greedy
