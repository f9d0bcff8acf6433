"""Common tools of all wings: units, geometry, random streams, parameter files, processes, tables."""
