"""SUMO: maps, demand, the running simulation. The only folder that imports libsumo."""
