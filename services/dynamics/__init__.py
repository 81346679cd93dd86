"""The vehicle: rigid body, rotors, controller and jerk-limited setpoint."""
