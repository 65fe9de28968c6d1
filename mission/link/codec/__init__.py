"""MAVLink bytes: frames, signing, dialect."""
