"""Bridge to ROS 2: this vehicle's topics, services and parameters on a network of rmw_zenoh."""
