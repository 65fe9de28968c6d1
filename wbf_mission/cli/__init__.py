"""Command line of wbf-mission."""
