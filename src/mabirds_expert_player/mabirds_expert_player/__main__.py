"""``python -m mabirds_expert_player``: the node as a process."""

import sys

from mabirds_msgs_py.early import loading


def main() -> int:
    """Run the node of this process."""
    with loading():
        from mabirds_expert_player.player_node import main as node
    return node()


if __name__ == "__main__":
    sys.exit(main())
