"""Judges records: the templates' predicates, the outcome, the checks of ``siren verify``."""
