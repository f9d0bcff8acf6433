"""Work in other processes or side by side: progress, killed and hanging workers, order."""
