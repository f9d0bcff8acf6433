"""The ROS 2 nodes, one per file: read the parameters, convert in, call the library, convert out."""

import os

# Idle threads of OpenBLAS spin after every large product and take a core from the cameras; read when numpy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
