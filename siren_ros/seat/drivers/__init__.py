"""Drivers of the library for the seat: by the law of a place, with a fault, and without any regard for sirens."""
