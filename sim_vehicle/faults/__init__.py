"""Faults that are injected on demand: links, protocol, vehicle."""
