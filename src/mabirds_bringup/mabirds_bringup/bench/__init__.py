"""What all benchmarks share: cases, the processes that run them, tables, targets, reports, curves."""
