"""What the ``mabirds`` command's exit codes mean."""

FINISHED = 0
BAD_INPUT = 2
"""A wrong experiment, bag, schedule or option; the message names value, expectation and remedy."""
PROCESS_DIED = 3
"""A learner or the player ended before its time; its log is named."""
NOBODY_THERE = 4
"""``inspect`` found no learner, topic, node or service, ``player`` no player, ``picture`` nothing that is drawn."""
INCOMPLETE = 5
"""A run ended, or a run directory was looked at, of which not everything is known; what is missing is named."""
INTERRUPTED = 130
"""Ctrl-C: everything was stopped."""
