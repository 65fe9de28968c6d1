"""Injects faults into simulated links, components and vehicles."""
