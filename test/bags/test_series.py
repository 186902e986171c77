# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint states of a bag as arrays."""

import bag_making as make
import numpy as np
import pytest
from bag_making import OTHER, START, STATES

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.errors import UserError
from estimator_pkg.messages.joint_state import Encoder


def test_joints_come_go_and_change_order(tmp_path):
    encode = Encoder().encode
    given = [
        (1, ['a', 'b'], [1.0, 2.0], [], [0.1, 0.2]),
        (2, ['b', 'a'], [3.0, 4.0], [5.0, 6.0], []),
        (3, ['b'], [7.0], [], []),
        (4, ['a', 'b'], [8.0], [], [0.3, 0.4]),
        (5, [], [], [], []),
    ]
    messages = [(STATES, START + 10 * stamp, encode(stamp, 'f', *rest)) for stamp, *rest in given]
    with open_bag(make.ours(tmp_path / 'bag', messages)) as bag:
        series = joint_series(bag, STATES)
    assert list(series) == ['a', 'b']
    nan = np.nan
    expected = {
        'a': ([1, 2, 4], [1, 4, nan], [nan, 6, nan], [0.1, nan, 0.3]),
        'b': ([1, 2, 3, 4], [2, 3, 7, nan], [nan, 5, nan, nan], [0.2, nan, nan, 0.4]),
    }
    for name, columns in expected.items():
        for found, wanted in zip(series[name], columns):
            np.testing.assert_array_equal(found, wanted)
        assert series[name].stamps_ns.dtype == np.int64


def test_what_has_no_joint_is_refused(tmp_path):
    messages = [(STATES, START, Encoder().encode(1, '', [])), (OTHER, START, make.text('x'))]
    with open_bag(make.ours(tmp_path / 'bag', messages)) as bag:
        with pytest.raises(UserError, match='names a joint'):
            joint_series(bag, STATES)
        with pytest.raises(UserError, match='is std_msgs/msg/String'):
            joint_series(bag, OTHER)
