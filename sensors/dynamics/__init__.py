"""Dynamics of fields, which change from day to day: epidemics, soil humidity, other continuous fields."""
