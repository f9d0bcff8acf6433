"""The only library code that knows ROS: lockstep, parameters, QoS."""
