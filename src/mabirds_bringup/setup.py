from pathlib import Path

from setuptools import find_packages, setup

NAME = "mabirds_bringup"
WORKSPACE = Path("../../ros_ws")  # from src/, wherever links to it are: this runs in this file's own directory

setup(
    name=NAME,
    version="0.1.0",
    description="Launching, supervision, inspection and reports of the MA-BIRDS network",
    license="Apache-2.0",
    maintainer="The MA-BIRDS on ROS 2 developers",
    maintainer_email="mabirds@example.org",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["templates/*.jinja"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(map(str, WORKSPACE.glob("config/*.yaml")))),
        (f"share/{NAME}/launch", sorted(map(str, WORKSPACE.glob("launch/*.launch.py")))),
    ],
    python_requires=">=3.11",
    install_requires=[
        "mabirds_learner",
        "mabirds_expert_player",
        "cryptography",
        "jinja2",
        "matplotlib",
        "polars",
        "rich",
        "typer",
    ],
    extras_require={"test": ["pytest"]},  # by which colcon knows how to test
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "mabirds = mabirds_bringup.cli:main",
        ],
    },
)
