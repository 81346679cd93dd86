"""The barometer: standard atmosphere, noise, calibration."""
