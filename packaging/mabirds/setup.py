"""The parts of MA-BIRDS, all of one version: a newer `mabirds` brings newer parts."""

from pathlib import Path

from setuptools import setup

VERSION = Path(__file__).with_name("VERSION").read_text(encoding="utf-8").strip()
PARTS = (
    "mabirds_core",
    "mabirds_msgs",
    "mabirds_msgs_py",
    "mabirds_expert_player",
    "mabirds_learner",
    "mabirds_bringup",
)
EXTRAS = {
    "bench": "mabirds_bringup[bench]",
    "drones": "mabirds_bringup[drones]",
    "sac": "mabirds_bringup[sac]",
    "report": "mabirds_core[report]",
    "security": "mabirds_bringup[security]",
}

setup(
    install_requires=[f"{part}=={VERSION}" for part in PARTS],
    extras_require={extra: [f"{part}=={VERSION}"] for extra, part in EXTRAS.items()},
)
