"""`autopilot`: an autopilot that is not ours, in the place of the simulated vehicle."""
