"""How learners of an experiment mix: the settings of either mixer, which stand beside it."""

from mabirds_core.consensus.push_sum_mixer import ResilientMixing
from mabirds_core.consensus.strict import StrictMixing

MixingSettings = StrictMixing | ResilientMixing
