"""Everything that the paper's tables say, next to what was measured here."""
