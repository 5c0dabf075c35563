"""Names of drawn topics: below ``drawn`` of the learner, or of the network."""

import re

DRAWN = "drawn"
SCENE, NETWORK, CONSENSUS = "scene", "network", "consensus"
COSTS, KEEPOUT, MARKERS, IMAGINED, DEMONSTRATED, SCALARS = (
    "costs",
    "keepout",
    "markers",
    "imagined",
    "demonstrated",
    "scalars",
)


def of_learner(namespace: str, *parts: str) -> str:
    """A topic of a learner.

    >>> of_learner("/learner_1", COSTS, of_expert(0))
    '/learner_1/drawn/costs/expert_1'
    """
    return "/".join([namespace, DRAWN, *parts])


def of_expert(expert: int) -> str:
    """The last part of a topic of an expert, by its index."""
    return f"expert_{expert + 1}"


def scalar(name: str) -> str:
    """A metric's name as the last part of a topic.

    >>> scalar("weight_sent.learner_2")
    'weight_sent_learner_2'
    """
    part = re.sub(r"[^A-Za-z0-9_]+", "_", name)[:80].strip("_")
    return part if part[:1].isalpha() else f"n_{part}"
