"""Drivers of the library: by the law of a place, with a fault, and without any regard for sirens."""
