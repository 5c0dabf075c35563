from setuptools import find_packages, setup

NAME = "mabirds_bringup"

setup(
    name=NAME,
    version="0.1.0",
    description="Launching, supervision, inspection and reports of the MA-BIRDS network",
    license="Apache-2.0",
    maintainer="The MA-BIRDS on ROS 2 developers",
    maintainer_email="mabirds@example.org",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["mabirds_learner", "mabirds_expert_player", "cryptography", "matplotlib", "rich", "typer"],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "mabirds = mabirds_bringup.cli:main",
        ],
    },
)
