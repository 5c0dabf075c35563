from setuptools import find_packages, setup

NAME = "mabirds_core"

setup(
    name=NAME,
    version="0.1.0",
    description="MA-BIRDS without ROS: games, policies, Algorithm 1, schedules, metrics",
    license="Apache-2.0",
    maintainer="The MA-BIRDS on ROS 2 developers",
    maintainer_email="mabirds@example.org",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["numpy", "pydantic", "PyYAML", "scipy", "torch"],
    extras_require={"test": ["pytest"]},  # by which colcon knows how to test
    zip_safe=False,
)
