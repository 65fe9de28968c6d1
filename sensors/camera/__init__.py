"""The leaf camera, and its messages on MAVLink."""
