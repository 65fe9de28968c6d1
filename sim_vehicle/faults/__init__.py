"""Fault injection: links, mission protocol, vehicle."""
