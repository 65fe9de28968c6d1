"""Add-ons, which the core does not import: each registers its commands and other parts as entry points."""
