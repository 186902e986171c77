"""The topic effort_command in a bag, for kinds of observers that know an input."""

from __future__ import annotations

from estimator_pkg.bags.reader import Bag, Topic
from estimator_pkg.driver.effort_command import ARRAY
from estimator_pkg.driver.efforts import COMMAND
from estimator_pkg.messages import joint_state, multi_array
from estimator_pkg.nodes.effort_settings import EffortSettings

EFFORTS = '/effort_command'


def effort_topics(bag: Bag, settings: EffortSettings) -> list[Topic]:
    """The topic, where the settings name it as the input; raises UserError if it is not there."""
    if settings.input != COMMAND:
        return []
    kind = multi_array.TYPE if settings.effort_command_type == ARRAY else joint_state.TYPE
    return [bag.require(EFFORTS, [kind])]
