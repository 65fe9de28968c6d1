"""Results of runs, and their folders."""
