"""MA-BIRDS without ROS: games, policies, Algorithm 1, mixing, schedules, metrics, the in-process network.

Multi-Agent Bi-level Inverse Reward and constraint learning from Distributed Streaming demonstrations
(Liu and Zhu, NeurIPS 2023). Equation numbers in this package are mapped in ``docs/equations.md``.
"""

__version__ = "0.1.0"
