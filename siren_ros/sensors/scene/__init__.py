"""The 3-D world that LiDAR and cameras see: triangles generated from the road network and vehicle shapes.

Import order inside: ``material`` < ``mesh`` < builders < ``static_scene`` and ``vehicle_shapes``.
"""
