"""Bounds of an episode's checks, and its physics: contacts, overlap, accelerations."""
