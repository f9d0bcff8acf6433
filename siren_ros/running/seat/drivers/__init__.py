"""Drivers of the library: lawful ones by place, faulty ones, and one that ignores sirens."""
