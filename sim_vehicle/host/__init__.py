"""Hosts of MAVLink components: a simulation on a virtual clock, a server on sockets, and routing."""
