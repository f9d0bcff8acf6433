"""The emergency vehicle (paper, Algorithm 1): its guards, gap escape, the copied corridor."""
