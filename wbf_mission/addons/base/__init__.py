"""Modules that several add-ons share, but the core does not need."""
