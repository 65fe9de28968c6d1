"""Market policy: vehicles of a fleet bid for survey segments."""
