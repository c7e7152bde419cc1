"""A day of faults and users in driven time; `python -m benchmarks.soak --help`."""
