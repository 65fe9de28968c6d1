"""Disk estimators."""
