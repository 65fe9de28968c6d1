"""Parts that several add-ons share and the core does not need."""
