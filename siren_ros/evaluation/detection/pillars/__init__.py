"""A learned detector: ten sweeps as pillars, a network with a centre head that onnxruntime runs."""
