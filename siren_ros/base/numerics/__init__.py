"""Units, geometry, random streams and compiled loops, which every other folder uses.

Conventions, stated once for the whole project:

* Frame ``map`` is ENU: x east, y north, z up, yaw counter-clockwise from east (REP 103). Where a map
  comes from OpenDRIVE, its origin is the OpenDRIVE origin.
* An actor's pose is the centre of its footprint on the ground; SUMO's front-bumper positions are
  converted in ``traffic/`` and nowhere else.
* SI units and radians everywhere; names carry the unit. Simulated time is integer nanoseconds.
* Arrays over actors ("structures of arrays") have shape ``(N,)`` and are sorted by ``actor_id``.
"""
