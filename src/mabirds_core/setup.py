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
    entry_points={
        "mabirds.games": [
            "patrol = mabirds_core.games.patrol.kind:PATROL",
            "drones = mabirds_core.games.drones.kind:DRONES",
        ],
        "mabirds.rewards": [
            "linear = mabirds_core.rewards.kinds:LINEAR",
            "neural = mabirds_core.rewards.kinds:NEURAL",
        ],
        "mabirds.planners": [
            "soft_value_iteration = mabirds_core.planners.kinds:SOFT_VALUE_ITERATION",
            "soft_q_learning = mabirds_core.planners.kinds:SOFT_Q_LEARNING",
            "lattice = mabirds_core.games.drones.kind:LATTICE",
            "soft_actor_critic = mabirds_core.games.drones.kind:SOFT_ACTOR_CRITIC",
        ],
        "mabirds.methods": [
            "bics = mabirds_core.baselines.kinds:BICS",
            "ftl = mabirds_core.baselines.kinds:FTL",
            "dlm = mabirds_core.baselines.kinds:DLM",
            "me_greedy = mabirds_core.baselines.kinds:ME_GREEDY",
            "me_gradient = mabirds_core.baselines.kinds:ME_GRADIENT",
        ],
        "mabirds.schedules": [
            "static = mabirds_core.consensus.kinds:STATIC",
            "alternating = mabirds_core.consensus.kinds:ALTERNATING",
            "directed_ring = mabirds_core.consensus.kinds:DIRECTED_RING",
            "random_matching = mabirds_core.consensus.kinds:RANDOM",
            "gossip = mabirds_core.consensus.kinds:RANDOM",
            "slots = mabirds_core.consensus.kinds:EXPLICIT",
        ],
        "mabirds.mixers": [
            "strict = mabirds_core.consensus.kinds:STRICT",
            "resilient = mabirds_core.consensus.kinds:RESILIENT",
        ],
        "mabirds.step_rules": ["paper = mabirds_core.algorithm.kinds:PAPER"],
    },
)
