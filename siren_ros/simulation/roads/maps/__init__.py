"""Maps from files: SUMO nets, OpenDRIVE and OpenStreetMap, compiled by netconvert."""
