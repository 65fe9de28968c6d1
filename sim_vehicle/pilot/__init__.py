"""Modes, arming, failsafes, fence, setpoints: the autopilot without MAVLink."""
