"""Speed against error, beside other programs: ``python -m benchmarks``."""
