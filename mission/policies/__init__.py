"""Policies, which decide in flight where one or several vehicles go next."""
