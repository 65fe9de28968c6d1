"""Autopilot without MAVLink: modes, arming, failsafes, fence, setpoints."""
