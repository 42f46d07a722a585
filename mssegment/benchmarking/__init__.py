"""Benchmarks on published data sets: run the pipeline on every sequence and evaluate the result.

The error is the misclassification defined in ``evaluation``. The true labels are removed before the
pipeline sees the tracks, and the tracks are shuffled with each seed.
"""

from mssegment.benchmarking.cases import Case, Options, add_outliers
from mssegment.benchmarking.disturbance import resampled, shuffled_in_time, uniform_mismatches
from mssegment.benchmarking.results import GroupSummary, SequenceResult, summarise
from mssegment.benchmarking.running import number_of_results, run_benchmark, run_case

__all__ = [
    "Case",
    "GroupSummary",
    "Options",
    "SequenceResult",
    "add_outliers",
    "number_of_results",
    "resampled",
    "run_benchmark",
    "run_case",
    "shuffled_in_time",
    "summarise",
    "uniform_mismatches",
]
