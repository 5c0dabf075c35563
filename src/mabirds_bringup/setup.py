from setuptools import setup

setup(python_requires=">=3.11")  # colcon cannot read this one out of pyproject.toml, where all the rest is
