from setuptools import setup

setup()  # for colcon; everything is in pyproject.toml
