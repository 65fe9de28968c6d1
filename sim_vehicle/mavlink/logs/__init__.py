"""Logs of flights: what a vehicle keeps of them in memory, and the messages that list and send them."""
