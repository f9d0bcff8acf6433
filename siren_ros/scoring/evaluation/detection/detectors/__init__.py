"""Detectors of the library; they run on recorded sweeps."""
