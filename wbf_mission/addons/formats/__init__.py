"""File formats that the core lacks: missions (`missions`) and farms (`farm_files`); command ``convert``."""
