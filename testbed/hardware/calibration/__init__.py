"""Servos, tilt sensors and cameras: what is measured, how it is gated, and how it is kept."""
