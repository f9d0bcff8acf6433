"""An episode in a CARLA server, which senses in place of this machine: as a node, or from a bag."""
