from setuptools import find_packages, setup

NAME = "mabirds_msgs_py"

setup(
    name=NAME,
    version="0.1.0",
    description="Message conversion, topic names, QoS profiles and bags of the MA-BIRDS network",
    license="Apache-2.0",
    maintainer="The MA-BIRDS on ROS 2 developers",
    maintainer_email="mabirds@example.org",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["mabirds_core", "mcap", "numpy", "PyYAML", "zstandard", "lz4"],
    extras_require={"test": ["pytest"]},  # by which colcon knows how to test
    zip_safe=False,
)
