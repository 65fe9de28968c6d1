"""The leaf camera and the wire form of what it saw."""
