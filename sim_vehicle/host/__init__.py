"""Hosts of components: simulation on a virtual clock, server on sockets, routing."""
