"""Flight of mission items: feasibility checks, leg plans, item sequence, and executor."""
