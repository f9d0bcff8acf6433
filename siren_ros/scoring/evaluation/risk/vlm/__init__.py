"""Asks vision-language models about risk videos, after SeeUnsafe (Zhang et al. 2025)."""
