"""Operation of vehicles on a link: their telemetry, and single orders."""
