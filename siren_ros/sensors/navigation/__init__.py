"""The GNSS receiver and the inertial measurement unit (IMU)."""
