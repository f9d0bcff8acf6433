"""Benchmarks: commands that print figures of this machine."""

import os

# Idle threads of OpenBLAS spin after every large product and take a core from what is measured; read when numpy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
