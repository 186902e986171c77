# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of rules: each rule is found in its source."""

import pytest

from benchmarks import rules

RULES = rules.rules()


@pytest.mark.parametrize('name', RULES)
def test_a_rule_that_is_switched_off_changes_one_place_of_python(name):
    _, source, pattern, without = RULES[name]
    text = rules.switched_off(source, pattern, without)
    assert text != (rules.ROOT / source).read_text()
    compile(text, source, 'exec')


def test_a_rule_that_is_not_there_is_named():
    _, source, _, _ = RULES['velocity random walk']
    with pytest.raises(ValueError, match=r"covariance.py has 'no such rule' 0 times"):
        rules.switched_off(source, 'no such rule', '')
