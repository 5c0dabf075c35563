"""What theta and omega mean to planners that took no part in learning them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from mabirds_bringup.evaluate.held_out import HeldOut
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import reward_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.whole_game import Game

ROLLOUTS = 2000
"""Of those who judge by rollouts: a rate of .97 is then known to .004."""


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
    held_out_log_likelihood : float or None
        Of a held-out demonstration, as this planner follows it [nats]; None without any.
    fixed_log_likelihood : float or None
        That of the likeliest policy that takes no learning.
    """

    violation_rate: float | None
    success_rate: float | None
    value: float | None
    certificate: float | None
    held_out_log_likelihood: float | None
    fixed_log_likelihood: float | None


Verdicts = Mapping[str, Verdict]
"""By the name of the planner; empty where the game has none, or the method no model of rewards."""


def numbers_of(experiment: Experiment, name: str, parameters: Parameters) -> bytes:
    """What decides a policy: learners mean the same by the same numbers, methods need not."""
    whose = b"" if name in experiment.learners else name.encode()
    return whose + b"".join(values.tobytes() for values in parameters)


def verdicts(
    experiment: Experiment, game: Game, held_out: HeldOut, final: Mapping[str, Parameters]
) -> dict[str, Verdicts]:
    """Judge by all planners that the game has for it.

    Parameters
    ----------
    experiment : Experiment
        What was learned.
    game : Game
        Of the experiment.
    held_out : HeldOut
        Demonstrations that nobody learned from.
    final : Mapping[str, Parameters]
        theta and omega by learner or method.

    Returns
    -------
    dict[str, Verdicts]
        By learner or method. Learners that ended with the same numbers are judged once.
    """
    asked = asked_of(experiment, game, final)
    return assembled(experiment, final, {of: verdict(experiment, game, held_out, *of, final[of[0]]) for of in asked})


def asked_of(experiment: Experiment, game: Game, final: Mapping[str, Parameters]) -> list[tuple[str, str]]:
    """Who is judged by which planner; of learners that ended with the same numbers only the first.

    Parameters
    ----------
    experiment : Experiment
        What was learned.
    game : Game
        Of the experiment.
    final : Mapping[str, Parameters]
        theta and omega by learner or method.

    Returns
    -------
    list
        Names of the learner or method and of the planner.
    """
    different = dict[bytes, str]()
    for name, parameters in final.items():
        different.setdefault(numbers_of(experiment, name, parameters), name)
    return [(name, planner) for name in different.values() for planner in _planners(experiment, game, name)]


def assembled(
    experiment: Experiment, final: Mapping[str, Parameters], told: Mapping[tuple[str, str], Verdict]
) -> dict[str, Verdicts]:
    """Give each learner its verdicts.

    Parameters
    ----------
    experiment : Experiment
        What was learned.
    final : Mapping[str, Parameters]
        theta and omega by learner or method.
    told : Mapping
        Of whom ``asked_of`` names.

    Returns
    -------
    dict[str, Verdicts]
        By learner or method.
    """
    found = dict[bytes, dict[str, Verdict]]()
    for (name, planner), of in told.items():
        found.setdefault(numbers_of(experiment, name, final[name]), {})[planner] = of
    return {name: found.get(numbers_of(experiment, name, parameters), {}) for name, parameters in final.items()}


def verdict(
    experiment: Experiment, game: Game, held_out: HeldOut, name: str, planner: str, parameters: Parameters
) -> Verdict:
    """One planner's verdict.

    Parameters
    ----------
    experiment : Experiment
        What was learned.
    game : Game
        Of the experiment.
    held_out : HeldOut
        Demonstrations that nobody learned from.
    name : str
        Of the learner or method.
    planner : str
        Of the planner.
    parameters : Parameters
        theta and omega.

    Returns
    -------
    Verdict
        By the game's judge.
    """
    judge, seed = game.judge, experiment.seed
    policy = _planners(experiment, game, name)[planner].plan(*parameters)
    violation, success = judge.imitation(policy, seed, ROLLOUTS) or (None, None)
    return Verdict(
        violation,
        success,
        judge.value(policy, seed),
        judge.certificate(policy, seed),
        held_out.log_likelihood(game, policy),
        max(held_out.fixed_log_likelihoods(game, policy).values(), default=None),
    )


def _planners(experiment: Experiment, game: Game, name: str) -> Mapping[str, Any]:
    """Planners for judging a learner or method, by name; none where there are none."""
    reward = reward_of(experiment, name, game)
    planners: Mapping[str, Any] = {} if reward is None else game.judging_planners(experiment.algorithm.policy, reward)
    return planners
