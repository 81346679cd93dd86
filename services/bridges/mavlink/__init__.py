"""Bridge to MAVLink: this vehicle as a PX4, for ground stations and programs of MAVSDK."""
