"""The static scene, generated from the road network: ground, markings, signals, buildings, plants.

Import order inside: ``config`` < ``surfaces`` < builders < ``static_scene``.
"""
