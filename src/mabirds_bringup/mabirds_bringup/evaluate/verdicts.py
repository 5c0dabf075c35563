"""What theta and omega mean to planners that took no part in learning them."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import reward_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.whole_game import Game


class Verdict(NamedTuple):
    """One judging planner's.

    Attributes
    ----------
    violation_rate, success_rate : float or None
        CVR and SR of the policy that it finds; None where nobody knows the true constraints.
    value : float or None
        Mean value V_0 of the starts [nats].
    certificate : float or None
        By how much the policy's rollouts miss that value [nats].
    """

    violation_rate: float | None
    success_rate: float | None
    value: float | None
    certificate: float | None


Verdicts = Mapping[str, Verdict]
"""By the name of the planner; empty where the game has none, or the method no model of rewards."""


def verdicts(
    experiment: Experiment, game: Game, final: Mapping[str, Parameters], on_step: Callable[[], None] = lambda: None
) -> dict[str, Verdicts]:
    """Judge by all planners that the game has for it.

    Parameters
    ----------
    experiment : Experiment
        What was learned.
    game : Game
        Of the experiment.
    final : Mapping[str, Parameters]
        theta and omega by learner or method.
    on_step : Callable, optional
        Called after each of them.

    Returns
    -------
    dict[str, Verdicts]
        By learner or method. Learners that ended with the same numbers are judged once.
    """
    found, result = dict[bytes, Verdicts](), dict[str, Verdicts]()
    for name, parameters in final.items():
        numbers = b"" if name in experiment.learners else name.encode()
        numbers += b"".join(values.tobytes() for values in parameters)
        if numbers not in found:
            found[numbers] = _verdicts(experiment, game, name, parameters)
        result[name] = found[numbers]
        on_step()
    return result


def _verdicts(experiment: Experiment, game: Game, name: str, parameters: Parameters) -> Verdicts:
    reward = reward_of(experiment, name, game)
    if reward is None:
        return {}
    planners: Mapping[str, Any] = game.judging_planners(experiment.algorithm.policy, reward)
    return {of: _verdict(experiment, game, planner.plan(*parameters)) for of, planner in planners.items()}


def _verdict(experiment: Experiment, game: Game, policy: Any) -> Verdict:
    judge, seed = game.judge, experiment.seed
    violation, success = judge.imitation(policy, seed) or (None, None)
    return Verdict(violation, success, judge.value(policy, seed), judge.certificate(policy, seed))
