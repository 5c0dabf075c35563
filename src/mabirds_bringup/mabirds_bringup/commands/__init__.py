"""The verbs of the ``mabirds`` command, one file each."""
