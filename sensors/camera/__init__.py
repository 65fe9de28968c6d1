"""The leaf camera, and the MAVLink messages that carry its readings."""
