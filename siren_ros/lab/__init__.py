"""What researchers start: training, learning, calibration, benchmarks and the figures of documents, for `cli` alone."""
