"""Flights of vehicles behind links."""
