"""What is believed of a farm, in blocks of cells: maps, and the report for the farmer."""
