# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""rqt_reconfigure has an editor for every live gain, with a slider where the gain is bounded.

The rules are those of its sources (version 1.6.2: param_client_widget.py, param_editors.py): which
descriptor gets which editor, and what an editor computes for its slider. An exception in one editor
leaves the page without all those that follow, so every parameter of a node counts, the fixed too.
"""

import array
from decimal import Decimal

import dds
import pytest
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from test_parameter_values import EVERY, MOTOR, declaring, parameters_of

from estimator_pkg.parameters import declared

INT32 = 2**31 - 1  # of a QSlider and a QIntValidator
TEXT = {RosParameter.Type.STRING, RosParameter.Type.STRING_ARRAY, RosParameter.Type.DOUBLE_ARRAY}


def slider(descriptor, value):
    """(lowest, highest, present position) of the slider as the editor computes it; None: no slider.

    Raises what the editor raises, and OverflowError where Qt's 32 bits do not suffice.
    """
    if descriptor.integer_range:
        (found,) = descriptor.integer_range
        low, high, step, position = found.from_value, found.to_value, found.step, int(value)
    elif descriptor.floating_point_range:
        (found,) = descriptor.floating_point_range
        scale = 100.0 / (float(found.to_value) - float(found.from_value))
        low, high, step, position = (
            round(number * scale)
            for number in (found.from_value, found.to_value, found.step, value)
        )
    else:
        return None
    if any(abs(number) > INT32 for number in (low, high, step, position)):
        raise OverflowError(f'{descriptor.name}: {low} to {high}')
    assert step == 0  # rclpy accepts every value of the range
    return low, high, position


def editor(descriptor, value):
    """Whether the editor has a slider; raises where it would."""
    kind = RosParameter.Type(descriptor.type)
    assert kind != RosParameter.Type.NOT_SET  # has no editor
    assert RosParameter(descriptor.name, value=value).type_ == kind
    if kind == RosParameter.Type.BOOL:
        return False
    if kind in TEXT:
        str(value.tolist() if isinstance(value, array.array) else value)
        return False
    assert kind in (RosParameter.Type.INTEGER, RosParameter.Type.DOUBLE)
    f'{Decimal(str(value)):f}'
    found = slider(descriptor, value)
    if found is None:
        return False
    low, high, position = found
    assert low < high and low <= position <= high, descriptor.name
    return True


@pytest.mark.parametrize('classes, per_joint', EVERY.values(), ids=EVERY)
def test_every_live_gain_has_an_editor_and_a_slider(classes, per_joint, probe, tmp_path):
    known = parameters_of(classes)
    motor = {name: value for name, value in MOTOR.items() if name in known}
    overridable = [name for cls in classes[len(classes) - per_joint :] for name in declared(cls)]
    with declaring(classes, motor, tmp_path, overridable) as (node, _):
        for name in node.list_parameters([], 0).names:
            descriptor, value = node.describe_parameter(name), node.get_parameter(name).value
            has_slider = editor(descriptor, value)
            if name in known and not known[name].structural:
                assert not descriptor.read_only
                assert has_slider == (known[name].kind in (int, float)), name


REFUSED = {  # by the range, by the observer at this rate, because it is fixed, by its type
    'bandwidth_hz': (-1.0, 'outside'),
    'observer': ('pll', 'structural'),
    'quantum': ('coarse', 'must be a number'),
}


def test_a_refused_value_is_logged(probe):
    """rqt_reconfigure shows the new value and drops the node's answer."""
    with dds.NodeProcess(
        'estimator_pkg.nodes.executables joint_observer',
        *dds.ros_args('observer:=hybrid_angle', 'bandwidth_hz:=20.0', remap=['__node:=edited']),
    ) as process:
        process.prints(' estimates ')
        names = probe.call(ListParameters, '/edited/list_parameters', ListParameters.Request())
        names = list(names.result.names)
        described = probe.call(
            DescribeParameters,
            '/edited/describe_parameters',
            DescribeParameters.Request(names=names),
        ).descriptors
        values = probe.call(
            GetParameters, '/edited/get_parameters', GetParameters.Request(names=names)
        ).values
        sliders = {
            descriptor.name
            for descriptor, value in zip(described, values)
            if editor(descriptor, parameter_value_to_python(value))
        }
        assert {'bandwidth_hz', 'quantum', 'gap_max', 'order'} <= sliders  # over DDS too
        same = SetParameters.Request(  # `ros2 param load` sets fixed parameters too
            parameters=[RosParameter('unwrap', value=False).to_parameter_msg()]
        )
        (result,) = probe.call(SetParameters, '/edited/set_parameters', same).results
        assert not result.successful  # of rclpy; nothing to log, since nothing would change
        for name, (value, why) in REFUSED.items():
            request = SetParameters.Request(
                parameters=[RosParameter(name, value=value).to_parameter_msg()]
            )
            (result,) = probe.call(SetParameters, '/edited/set_parameters', request).results
            assert not result.successful
            process.prints(f"parameters are not changed: parameter '{name}'")
            assert why in process.output
        assert process.output.count('are not changed') == len(REFUSED)
