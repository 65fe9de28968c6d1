"""The MAVLink camera component that carries the leaf camera."""
