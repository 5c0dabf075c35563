"""``python -m mabirds_learner``: the node as a process."""

import sys

from mabirds_learner.learner_node import main

sys.exit(main())
