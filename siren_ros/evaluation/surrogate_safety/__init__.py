"""Surrogate safety measures: how close vehicles came to a contact, from an episode's record."""
