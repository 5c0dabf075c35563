"""Names of topics. A learner lives in a namespace of its own name: /learner_1, or /fleet/learner_1."""

DEMONSTRATION = "demonstration"
PARAMETERS = "parameters"
STATUS = "status"
CONSTRAINTS = "constraints"
EDGE_SCHEDULE = "edge_schedule"
FEATURE_NAMES = "feature_names"
DIAGNOSTICS = "/diagnostics"
FETCH_PARAMETERS = "fetch_parameters"
MEMBERSHIP = "membership"


def mass(receiver: str) -> str:
    """Where a learner in resilient mode tells ``receiver`` what it gave, relative to its own namespace.

    >>> mass("learner_2")
    'mass/learner_2'
    """
    return f"mass/{receiver}"


def of_run(service: str, run: str, digest: str, *, secured: bool) -> str:
    """The name of a service in one run, so that nobody asks the namesake of another one in the same domain.

    Of several servers of one name the first that answers would be heard. Where security is on, names are those of the
    policy, which knows no runs; strangers are kept out by it.

    Parameters
    ----------
    service : str
        Its name.
    run : str
        Name of the run; empty: it has none.
    digest : str
        Of the run.
    secured : bool
        Security is on.

    Returns
    -------
    str
        Relative as ``service`` is.

    Examples
    --------
    >>> of_run("fetch_parameters", "monday", "v3-0123456789abcdef0123", secured=False)
    'fetch_parameters/run_0123456789abcdef'
    >>> of_run("fetch_parameters", "", "v3-0123456789abcdef0123", secured=False)
    'fetch_parameters'
    """
    return service if secured or not run else f"{service}/run_{digest.rpartition('-')[2][:16]}"


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
