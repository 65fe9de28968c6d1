"""The command ``sim``: simulated vehicles on UDP, TCP and serial lines."""
