"""Flying: goto, cage, calibrate, hold, reset, state."""
