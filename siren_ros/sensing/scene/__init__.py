"""The static scene, generated from the road network: ground, markings, signals, buildings, plants."""
