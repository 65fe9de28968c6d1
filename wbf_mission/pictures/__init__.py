"""Figures, colours and farms by matplotlib."""
