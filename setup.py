"""One ament_python package, velocity_estimator, that carries estimator_pkg and sim_pkg.

Dependencies are pinned here and nowhere else. On an apt installation of Jazzy the nodes need rclpy,
the messages and numpy alone; `make install` installs everything with ``.[all]``.
"""

from glob import glob

from setuptools import setup

NAME = 'velocity_estimator'

EXTRAS = {
    'ros': ['ros-jazzy-rclpy>=7.1,<8', 'ros-jazzy-common-interfaces>=5.3,<6',
            'ros-jazzy-rmw-fastrtps-cpp>=8.4,<9'],
    'fast': ['numba>=0.61,<1'],
    'report': ['matplotlib>=3.8,<4', 'bokeh>=3.4,<4'],
    'tune': ['optuna>=4,<5'],
    'cluster': ['dask>=2024.8,<2030', 'distributed>=2024.8,<2030'],
    'docs': ['mkdocs-material>=9.5,<10'],
    'peers': ['pynumdiff>=0.3,<1; python_version >= "3.11"', 'control>=0.10,<1'],
    'test': ['pytest>=8,<10', 'pytest-timeout>=2.3,<3', 'pytest-rerunfailures>=14,<17',
             'hypothesis>=6.100,<7', 'scipy>=1.11,<2',
             'filterpy>=1.4,<3', 'psutil>=5.9,<8', 'selenium>=4.20,<5', 'ruff>=0.6,<1',
             'mypy>=1.10,<3',
             'motulator>=0.5,<0.6', 'types-PyYAML', 'colcon-common-extensions>=0.3,<1'],
}
EXTRAS['all'] = sorted({name for names in EXTRAS.values() for name in names})

setup(
    name=NAME,
    version='0.1.0',
    packages=['estimator_pkg', 'estimator_pkg.observers', 'estimator_pkg.models',
              'estimator_pkg.driver', 'estimator_pkg.messages', 'estimator_pkg.nodes',
              'estimator_pkg.nodes.bench', 'estimator_pkg.bags', 'estimator_pkg.bags.kinds',
              'estimator_pkg.evaluation', 'estimator_pkg.evaluation.tuning',
              'sim_pkg', 'sim_pkg.nodes', 'sim_pkg.reproduce', 'sim_pkg.demo'],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/config', glob('config/*.yaml')),
    ],
    install_requires=['numpy>=1.26,<3', 'PyYAML>=6,<7', 'rosbags>=0.10,<0.12', 'mcap>=1.2,<2',
                      'rich>=13,<16'],
    extras_require=EXTRAS,
    python_requires='>=3.10',
    zip_safe=True,
    author='velocity_estimator maintainers',
    maintainer='velocity_estimator maintainers',
    maintainer_email='velocity-estimator@example.org',
    description='Live velocity estimation for ROS 2: observers, simulators, bags and tuning.',
    license='Apache-2.0',
    tests_require=['pytest'],
    entry_points={
        'console_scripts': [
            'velocity_estimator = estimator_pkg.cli:main',
            'joint_observer = estimator_pkg.nodes.joint_observer:main',
            'adaptive_observer = estimator_pkg.nodes.adaptive_observer:main',
            'switched_observer = estimator_pkg.nodes.switched_observer:main',
            'encoder_sim = sim_pkg.nodes.encoder_sim:main',
            'dc_motor_sim = sim_pkg.nodes.dc_motor_sim:main',
            'gripper_sim = sim_pkg.nodes.gripper_sim:main',
            'cart_pendulum_sim = sim_pkg.nodes.cart_pendulum_sim:main',
            'robotic_leg_sim = sim_pkg.nodes.robotic_leg_sim:main',
            'pendulum_sim = sim_pkg.nodes.pendulum_sim:main',
            'mechanical_observer = estimator_pkg.nodes.mechanical_observer:main',
            'pmsm_observer = estimator_pkg.nodes.pmsm_observer:main',
            'pmsm_sim = sim_pkg.nodes.pmsm_sim:main',
        ],
        'velocity_estimator.observers': [
            'hybrid_angle = estimator_pkg.observers.hybrid_angle:OBSERVER',
            'pmsm = estimator_pkg.observers.pmsm:OBSERVER',
            'finite_difference = estimator_pkg.observers.finite_difference:OBSERVER',
            'pll = estimator_pkg.observers.pll:OBSERVER',
            'kalman = estimator_pkg.observers.kalman:OBSERVER',
            'super_twisting = estimator_pkg.observers.super_twisting:OBSERVER',
            'geso = estimator_pkg.observers.geso:OBSERVER',
            'hgo = estimator_pkg.observers.hgo:OBSERVER',
            'ehgo = estimator_pkg.observers.ehgo:OBSERVER',
            'smo = estimator_pkg.observers.smo:OBSERVER',
            'adaptive = estimator_pkg.observers.adaptive:OBSERVER',
            'switched = estimator_pkg.observers.switched:OBSERVER',
            'edge_adaptive = estimator_pkg.observers.edge_adaptive:OBSERVER',
        ],
        'velocity_estimator.kinds': [
            'angle = estimator_pkg.bags.kinds.angle:KIND',
            'mechanical = estimator_pkg.bags.kinds.mechanical:KIND',
            'drive = estimator_pkg.bags.kinds.drive:KIND',
            'angle_and_input = estimator_pkg.bags.kinds.adaptive:KIND',
            'switched = estimator_pkg.bags.kinds.switched:KIND',
        ],
        'velocity_estimator.settings': [
            'simulator_nodes = sim_pkg.nodes.settings:RunSettings',
            'known_inputs = estimator_pkg.driver.efforts:DrivenSettings',
            'pmsm_observer = estimator_pkg.nodes.pmsm_settings:PmsmSettings',
            'mechanical_observer = estimator_pkg.nodes.mechanical_settings:MechanicalNodeSettings',
            'adaptive_observer = estimator_pkg.nodes.adaptive_settings:AdaptiveNodeSettings',
            'switched_observer = estimator_pkg.nodes.switched_settings:SwitchedNodeSettings',
            'mechanisms = estimator_pkg.driver.mechanism:MechanismSettings',
        ],
        'velocity_estimator.models': [
            'single_joint = estimator_pkg.models.single_joint:MODEL',
            'cart_pendulum = estimator_pkg.models.cart_pendulum:MODEL',
            'robotic_leg = estimator_pkg.models.robotic_leg:MODEL',
            'two_links = estimator_pkg.models.two_links:MODEL',
        ],
        'velocity_estimator.commands': [
            'demo = sim_pkg.demo.command:COMMAND',
            'list = estimator_pkg.listing:COMMAND',
            'simulate = sim_pkg.simulate:COMMAND',
            'record = estimator_pkg.bags.record:COMMAND',
            'play = estimator_pkg.bags.play:COMMAND',
            'replay = estimator_pkg.bags.replay:COMMAND',
            'evaluate = estimator_pkg.evaluation.evaluate:COMMAND',
            'identify = estimator_pkg.evaluation.identify:COMMAND',
            'tune = estimator_pkg.evaluation.tuning.command:COMMAND',
            'reproduce = sim_pkg.reproduce.command:COMMAND',
            'bench = estimator_pkg.evaluation.bench:COMMAND',
        ],
        'velocity_estimator.simulators': [
            'encoder = sim_pkg.encoder:SIMULATOR',
            'dc_motor = sim_pkg.dc_motor:SIMULATOR',
            'gripper = sim_pkg.gripper:SIMULATOR',
            'cart_pendulum = sim_pkg.cart_pendulum:SIMULATOR',
            'robotic_leg = sim_pkg.robotic_leg:SIMULATOR',
            'pendulum = sim_pkg.pendulum:SIMULATOR',
            'pmsm = sim_pkg.pmsm_simulator:SIMULATOR',
        ],
        'velocity_estimator.reproductions': [
            'hybrid_angle = sim_pkg.reproduce.hybrid_angle:REPRODUCTION',
            'pmsm = sim_pkg.reproduce.pmsm:REPRODUCTION',
            'adaptive = sim_pkg.reproduce.adaptive:REPRODUCTION',
            'hybrid_discrete = sim_pkg.reproduce.hybrid_discrete:REPRODUCTION',
            'mechanical = sim_pkg.reproduce.mechanical:REPRODUCTION',
        ],
    },
)
