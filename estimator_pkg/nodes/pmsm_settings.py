"""What is set of `pmsm_observer` beside its observer's gains. Imports no ROS: replay reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from estimator_pkg import observers
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.drive_joint import DriveJoint
from estimator_pkg.driver.drive_stream import DriveStream
from estimator_pkg.driver.pairs import Phases
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import parameter

DRIVE_SAMPLES, CURRENT_VOLTAGE = 'drive_samples', 'current_voltage'
ALPHA_BETA, ABC = 'alpha_beta', 'abc'
KIND = 'drive'


@dataclass(frozen=True)
class PmsmSettings:
    """Parameters of the node `pmsm_observer` beside those of its observer."""

    observer: str = parameter(
        'pmsm', unit='', structural=True, description='which observer of a drive')
    joint: str = parameter(
        'motor', unit='', structural=True,
        description='name of the joint: mechanical speed and relative position are published under '
                    'it, electrical ones under this and _electrical')
    input: str = parameter(
        DRIVE_SAMPLES, unit='', choices=(DRIVE_SAMPLES, CURRENT_VOLTAGE), structural=True,
        description='what is read: batches (drive_samples, std_msgs/Float64MultiArray), or the '
                    'topics current and voltage (geometry_msgs/Vector3Stamped) paired by stamp')
    sample_period: float = parameter(
        0.0, unit='s', range=(0.0, 0.1), structural=True,
        description='time between two rows of a batch; stamps that do not fit are refused. 0: as '
                    'the stamps say')
    frame: str = parameter(
        ALPHA_BETA, unit='', choices=(ALPHA_BETA, ABC), structural=True,
        description='current and voltage: x alpha and y beta; or x, y, z the phases a, b, c of a '
                    'star without neutral')
    pair_tolerance: float = parameter(
        2e-5, unit='s', range=(0.0, 1.0), structural=True,
        description='stamps of current and voltage that belong together differ by at most this')
    sum_tolerance: float = parameter(
        0.1, unit='', range=(0.0, 10.0), structural=True,
        description='phase currents may sum to this part of the largest one of late; beyond it '
                    'they are not used')
    compile: bool = parameter(
        True, unit='', structural=True,
        description='drive_samples: compile the observer at start where the extra fast is '
                    'installed (takes seconds once; then a tenth of the time per sample)')

    def check(self) -> None:
        """What a range cannot say; raises UsageError."""
        if not self.joint:
            raise UsageError("parameter 'joint' must not be empty")

    def find(self) -> Observer:
        """The observer; raises UsageError where it is none of a drive."""
        found = observers.find(self.observer)
        if found.kind != KIND:
            raise UsageError(f"observer '{found.name}' does not work from currents and voltages")
        return found

    def stream(self, configuration: Configuration) -> DriveStream:
        """The motor behind its topics; raises UsageError for motor data that cannot be right."""
        gains, settings = configuration.for_joint(self.joint)
        joint: Any = DriveJoint(configuration.observer, gains, settings,
                                sample_period=self.sample_period,
                                fast=self.compile and self.input == DRIVE_SAMPLES)
        phases = Phases(self.sum_tolerance) if self.frame == ABC else None
        return DriveStream(joint, self.joint, pair_tolerance=self.pair_tolerance,
                           phases=phases if self.input == CURRENT_VOLTAGE else None)
