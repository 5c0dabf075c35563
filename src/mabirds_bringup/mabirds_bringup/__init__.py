"""Launching and supervision of processes, the ``mabirds`` command, inspection, evaluation and reports."""
