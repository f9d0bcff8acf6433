"""The static scene, generated from the road network: ground, markings, signals, buildings, plants.

Import order inside: ``config`` < ``surfaces`` < ``ground``, ``signals`` < ``static_scene``.
"""
