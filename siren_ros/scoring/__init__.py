"""Scores records: whether the interaction happened, and how well models did."""
