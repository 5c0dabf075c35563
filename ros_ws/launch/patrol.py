"""Start the patrol experiment: one process per learner plus the expert player. Options are those of ``mabirds run``.

Example: python ros_ws/launch/patrol.py --rate 10
"""

import sys
from pathlib import Path

from mabirds_bringup.cli import main

EXPERIMENT = Path(__file__).resolve().parents[1] / "config" / "patrol.yaml"

if __name__ == "__main__":
    sys.argv[1:1] = ["run", str(EXPERIMENT)]
    main()
