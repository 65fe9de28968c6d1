"""Flights and transfers that MAVSDK carries out: a second way, independent of our own."""
