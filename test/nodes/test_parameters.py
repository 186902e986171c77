# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a user sets of joint_observer: YAML, settings, raw angles; lost messages."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from estimator_pkg import observers, params_file
from estimator_pkg.driver.configuration import Configuration, JointSettings
from estimator_pkg.driver.raw_angle import RawAngle
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.shared import AngleGains
from estimator_pkg.parameters import build, declared
from estimator_pkg.ros.loss import Loss
from estimator_pkg.streams.angle import AngleSettings

ROOT = Path(__file__).parents[2]
YAML = ROOT / 'config/joint_observer.yaml'
KEY = re.compile(r'    (#?)([\w.]+): (.+)$')


def yaml_sections():
    """{section: {key: (value, is set)}}; every key stands below its sentence."""
    sections, section = {}, None
    lines = YAML.read_text().splitlines()
    for number, line in enumerate(lines):
        title = re.match(r'    # ---- ([\w ]+?) -+$', line)
        if title:
            section = sections.setdefault(title[1], {})
        key = KEY.match(line)
        if key and section is not None:
            assert key[2] not in section
            section[key[2]] = (yaml.safe_load(key[3]), not key[1])
            before = lines[number - 1]
            assert (
                before.startswith('    # ')
                or before.startswith('    #per_joint.')
                or before.startswith('    #qos_')
            ), line
    return sections


def angle_observers():
    found = [observers.find(name) for name in observers.names()]
    return [observer for observer in found if observer.kind == 'angle']


def assert_taught(section, parameters):
    """Each parameter is there, with its default; automatic ones with the value that says so."""
    for name, parameter in parameters.items():
        assert name in section, f'{name} is missing in {YAML.name}'
        value, _ = section[name]
        assert parameter.check(value) == parameter.default, name
    extra = {name for name in section if '.' not in name} - set(parameters)
    assert not extra


def test_yaml_teaches_every_key():
    sections, shared = yaml_sections(), declared(AngleGains)
    assert_taught(sections.pop('input'), declared(AngleSettings))
    assert_taught(sections.pop('joints'), {**declared(JointSettings), **shared})
    for observer in angle_observers():
        own = {name: one for name, one in declared(observer.gains).items() if name not in shared}
        assert_taught(sections.pop(observer.name), own)
    assert set(sections) == {'quality of service'}


@pytest.mark.parametrize('observer', angle_observers(), ids=lambda observer: observer.name)
def test_what_the_yaml_sets_suits_every_observer(observer):
    values, overrides = params_file.split(params_file.load(YAML))
    assert overrides == {}
    node = {name: value for name, value in values.items() if name in declared(AngleSettings)}
    settings = build(AngleSettings, node)
    settings.find_observer()
    rest = {name: value for name, value in values.items() if name not in node}
    assert Configuration(observer, rest).for_joint('any') == Configuration(observer).for_joint(
        'any'
    )


# Settings


@pytest.mark.parametrize(
    ('values', 'reported'),
    [
        ({'input': 'angle', 'angle_joint': ''}, "'angle_joint' must not be empty"),
        ({'input': 'angle', 'joints': ['other']}, "'joint' is not in 'joints'"),
    ],
)
def test_settings_that_cannot_work(values, reported):
    with pytest.raises(UsageError, match=reported):
        build(AngleSettings, values).find_observer()


def test_counts_imply_the_quantum_unless_it_is_set():
    counted = build(AngleSettings, {'input': 'angle', 'counts_per_revolution': 1000})
    assert counted.implied({'quantum': 0.0, 'noise': 1.0}) == {
        'quantum': pytest.approx(2.0 * math.pi / 1000),
        'noise': 1.0,
    }
    assert counted.implied({'quantum': 0.5}) == {'quantum': 0.5}
    stated = build(AngleSettings, {'counts_per_revolution': 1000})  # not used with joint_states
    assert stated.implied({'quantum': 0.0}) == {'quantum': 0.0}


def test_raw_angles():
    raw = RawAngle(4096.0, offset=0.5, sign=-1)
    assert raw.angle(1024) == pytest.approx(0.5 - 0.5 * math.pi)
    assert raw.quantum == pytest.approx(2.0 * math.pi / 4096)
    counts = np.array([0, 1, 4095, -7])
    assert raw.angle(counts).tolist() == [raw.angle(int(count)) for count in counts]
    assert RawAngle(offset=1.0).angle(0.25) == 1.25 and RawAngle().quantum == 0.0


# Loss

BEGIN, LEFT = 10**18, None


def at(*numbers, later=0):
    """Messages of these numbers, each sent at its number [s] and so much later."""
    return [(number, number + later) for number in numbers]


STAYS = [*at(*range(1, 11)), LEFT, *at(*range(11, 14))]
GAP = at(*range(1, 11), *range(60, 70), 72)
LOSSES = {  # publishers, time from which messages count [ns], messages and those that leave; lost
    'nothing': (1, 0, at(1, 2, 3), 0),
    'no numbers': (1, 0, [(None, 0), (0, 0)], 0),
    'what is missing': (1, 0, at(7, 8, 11, 12, 20), 2 + 7),
    'another publisher in the place of the first': (1, 0, at(50, 51, 1, 2, 4), 1),
    'one that left is forgotten': (1, 0, [*at(1, 2, 3), LEFT, *at(700, 702)], 1),
    'one that stays when another leaves is not new': (2, BEGIN, STAYS, 0),
    'a new one, whose first messages nobody got': (2, BEGIN, [*STAYS, *at(6, 7, 8, later=14)], 5),
    'a gap beside a silent publisher': (2, 0, GAP, 49 + 2),
    'the same, of messages that count': (2, BEGIN, GAP, 49 + 2),
    'the first message is there': (1, BEGIN, at(1, 2, 3, 4, 5, 8, later=4), 2),
    'sent before the first one came': (1, BEGIN, at(31, 32, 33, 34, 35, 38, later=9), 30 + 2),
    'sent before anybody was there': (1, BEGIN, at(31, 32, 33, 34, 35, 38, later=-11), 2),
}


@pytest.mark.parametrize('case', LOSSES)
def test_loss_is_what_is_missing(case):
    publishers, since_ns, messages, lost = LOSSES[case]
    loss, now_ns = Loss(lambda: publishers, since_ns), BEGIN
    for message in messages:
        if message is LEFT:
            loss.forget(now_ns)
            continue
        number, sent = message
        now_ns = BEGIN + sent * 10**9
        loss.saw(number, now_ns)
    assert loss.count == lost


@pytest.mark.long
@given(st.data())
def test_the_sum_is_right_whichever_publisher_lost(data):
    """Two publishers, interleaved anyhow, until both have come to the same number."""
    streams, lost = [], 0
    first, ahead = data.draw(st.integers(1, 20)), data.draw(st.sampled_from([0, *range(2, 20)]))
    for start in (first, first + ahead):  # heard one after the other, seen to be two
        between = range(start + 1, 50)
        heard = data.draw(st.lists(st.sampled_from(between), unique=True).map(sorted))
        lost += len(between) - len(heard)
        streams.append([start, *heard, 50])
    loss = Loss(lambda: 2)
    loss.saw(streams[0].pop(0))
    loss.saw(streams[1].pop(0))
    while any(streams):
        stream = data.draw(st.sampled_from([stream for stream in streams if stream]))
        loss.saw(stream.pop(0))
    assert loss.count == lost


def test_where_there_are_no_sequence_numbers_the_middleware_is_believed():
    loss = Loss(lambda: 1)
    loss.reported = 3
    assert loss.lost == 3
    loss.saw(5)
    loss.saw(7)
    assert loss.lost == 1
