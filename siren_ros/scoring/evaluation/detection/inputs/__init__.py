"""Reads detections of other programs: one file per format, and checks common to all."""
