"""Flights and transfers by MAVSDK, an implementation independent of our own."""
