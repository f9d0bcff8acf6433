"""SIREN's own predictor: what it sees as arrays, and the trained network run by onnxruntime."""
