"""Commands for researchers: training, learning, calibration, benchmarks, figures of documents.

Only `cli` imports it.
"""
