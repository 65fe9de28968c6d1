"""Faults that are injected into simulated links, components and vehicles."""
