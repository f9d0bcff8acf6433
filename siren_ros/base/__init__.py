"""What every wing uses: units, geometry, random streams, parameter files, processes, tables."""
