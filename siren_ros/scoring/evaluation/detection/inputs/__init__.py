"""Detections of other programs: one file for each format, and what is refused in all of them."""
