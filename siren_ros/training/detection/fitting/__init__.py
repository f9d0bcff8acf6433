"""The detector's network, its fitting and its export as ONNX; needs torch."""
