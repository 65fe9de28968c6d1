"""Decisions in flight: who is asked when, what is sent to whom, and the record of it."""
