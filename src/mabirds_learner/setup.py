from setuptools import find_packages, setup

NAME = "mabirds_learner"

setup(
    name=NAME,
    version="0.1.0",
    description="The learner node of the MA-BIRDS network",
    license="Apache-2.0",
    maintainer="The MA-BIRDS on ROS 2 developers",
    maintainer_email="mabirds@example.org",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["mabirds_core", "mabirds_msgs_py", "numpy", "safetensors"],
    extras_require={"test": ["pytest"]},  # by which colcon knows how to test
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "mabirds-learner = mabirds_learner.learner_node:main",
            "learner = mabirds_learner.learner_node:main",
            "mabirds-central = mabirds_learner.central_node:main",
            "central = mabirds_learner.central_node:main",
        ],
    },
)
