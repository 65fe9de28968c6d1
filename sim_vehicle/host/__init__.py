"""Hosts of MAVLink components: simulation on a virtual clock, server on sockets, routing."""
