"""The world of an episode and everything that moves in it: roads, scenarios, SUMO's traffic, drivers, dynamics."""
