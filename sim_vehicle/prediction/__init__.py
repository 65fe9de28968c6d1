"""What a mission will take, without telemetry."""
