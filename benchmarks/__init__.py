"""Benchmarks; all run with one BLAS thread, because two make these small products slower."""

import os

# numpy reads these when it is imported, so they are set before any benchmark does that
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
