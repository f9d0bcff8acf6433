"""Detectors that run here, on the recorded sweeps."""
