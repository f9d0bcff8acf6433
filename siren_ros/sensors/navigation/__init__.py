"""Satellite receiver and inertial unit."""
