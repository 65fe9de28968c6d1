"""Policies: who decides in flight, for one or several vehicles, where to go next."""
