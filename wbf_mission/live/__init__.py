"""Flights of vehicles at the other end of a link."""
