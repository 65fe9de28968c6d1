"""Specification of a vehicle, catalogue of vehicles, errors of sensors."""
