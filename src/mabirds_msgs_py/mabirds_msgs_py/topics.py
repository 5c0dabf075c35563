"""Names of topics. A learner lives in a namespace of its own name: /learner_1, or /fleet/learner_1."""

DEMONSTRATION = "demonstration"
PARAMETERS = "parameters"
STATUS = "status"
CONSTRAINTS = "constraints"
EDGE_SCHEDULE = "edge_schedule"
DIAGNOSTICS = "/diagnostics"
FETCH_PARAMETERS = "fetch_parameters"
MEMBERSHIP = "membership"


def mass(receiver: str) -> str:
    """Where a learner in resilient mode tells ``receiver`` what it gave, relative to its own namespace.

    >>> mass("learner_2")
    'mass/learner_2'
    """
    return f"mass/{receiver}"


def split_namespace(namespace: str) -> tuple[str, str]:
    """The fleet's namespace and the learner's name.

    >>> split_namespace("/learner_1"), split_namespace("/fleet/learner_1")
    (('/', 'learner_1'), ('/fleet/', 'learner_1'))
    """
    fleet, _, learner = namespace.rpartition("/")
    return f"{fleet}/", learner


def bag_topic(learner: str) -> str:
    """Where a learner's demonstrations are recorded.

    >>> bag_topic("learner_1")
    '/learner_1/demonstration'
    """
    return f"/{learner}/{DEMONSTRATION}"
