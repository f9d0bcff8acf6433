"""The emergency vehicle (paper, Algorithm 1): forced lane changes, the copied corridor, gap escape."""
