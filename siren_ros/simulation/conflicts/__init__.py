"""Where vehicles will go, where their ways meet, and who waits there."""
