"""ROS parameters, declared from one frozen dataclass per node."""
