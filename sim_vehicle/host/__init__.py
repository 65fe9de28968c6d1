"""Who runs components: simulation, server, routing."""
