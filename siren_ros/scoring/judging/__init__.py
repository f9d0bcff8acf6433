"""Judges a record: the templates' predicates, the outcome, the checks of ``siren verify``."""
