"""Dynamics of fields from day to day: epidemics, soil humidity and other continuous fields."""
