"""Work in processes of its own or side by side: progress, killed and hanging workers, order."""
