"""The command line of wbf-mission."""
