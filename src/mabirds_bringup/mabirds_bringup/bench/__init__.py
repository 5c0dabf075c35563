"""Benchmarks: studies declared in files, the processes that run their cases, tables, targets, figures, reports."""
