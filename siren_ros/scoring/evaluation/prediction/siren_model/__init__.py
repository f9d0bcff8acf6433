"""SIREN's own predictor: its inputs as arrays, and the trained network, run by onnxruntime."""
