from setuptools import find_packages, setup

NAME = "mabirds_expert_player"

setup(
    name=NAME,
    version="0.1.0",
    description="Experts, the recorder of demonstrations and the node that plays them",
    license="Apache-2.0",
    maintainer="The MA-BIRDS on ROS 2 developers",
    maintainer_email="mabirds@example.org",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["mabirds_core", "mabirds_msgs_py", "numpy", "scipy"],
    extras_require={"test": ["pytest"]},  # by which colcon knows how to test
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "mabirds-expert-player = mabirds_expert_player.player_node:main",
            "expert_player = mabirds_expert_player.player_node:main",
        ],
    },
)
