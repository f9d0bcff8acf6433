"""The world of an episode and all that moves in it: roads, scenarios, SUMO's traffic, drivers, vehicle dynamics."""
