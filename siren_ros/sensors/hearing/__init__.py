"""Microphones, and the sound of a siren."""
