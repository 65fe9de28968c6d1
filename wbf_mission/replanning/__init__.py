"""Decisions in flight: asking the policy, sending new paths to the vehicles, and recording both."""
