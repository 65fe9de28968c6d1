"""Maps of an estimate by blocks of cells, and the report for the farmer."""
