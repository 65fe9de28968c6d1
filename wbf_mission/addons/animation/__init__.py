"""Animations of finished runs, as GIF or MP4."""
