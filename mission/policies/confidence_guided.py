"""Where `ConfidenceGuided` was before version 0.2: installations made before name it so."""

from mission.policies.authors.confidence_guided import ConfidenceGuided as ConfidenceGuided
