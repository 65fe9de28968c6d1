"""Add-ons: what the core does not know. Each registers its commands and other parts as entry points."""
