"""Drives the AV under test without another program: the driver's view, its path, its pedals and steering."""
