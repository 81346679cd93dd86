"""Barometer: standard atmosphere, noise, calibration."""
