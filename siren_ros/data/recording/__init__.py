"""Episode bags: written, read, repaired, played; the record of an episode in memory."""
