"""Writes, reads, repairs and plays bags of episodes, and holds the record of an episode in memory."""
