"""Emergency-vehicle interactions: generated from behaviour, sensed, recorded and scored."""

__version__ = "0.1.0"
