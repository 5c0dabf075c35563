"""``python -m mabirds_expert_player``: the node as a process."""

import sys

from mabirds_expert_player.player_node import main

sys.exit(main())
