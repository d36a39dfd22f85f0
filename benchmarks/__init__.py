"""Speed, measured apart from the tests: `make bench`, or `python -m benchmarks`."""

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")  # read when NumPy is loaded: everybody computes on one core
