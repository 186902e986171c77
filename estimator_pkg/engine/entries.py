# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The functions that the engine of the package has: (module, function, static modules, C name)."""

from .translate import Entry

ANGLE = 'estimator_pkg.observers.angle'
OF_AN_ANGLE = {  # observers of a single angle, by the prefix of their functions
    'edge_adaptive': f'{ANGLE}.edge.observer',
    'finite_difference': f'{ANGLE}.finite_difference',
    'hybrid_angle': f'{ANGLE}.hybrid.observer',
    'kalman': f'{ANGLE}.kalman',
    'pll': f'{ANGLE}.pll',
    'super_twisting': f'{ANGLE}.super_twisting.observer',
}
INFORMED = ('edge_adaptive', 'kalman')  # observers that other sensors may inform
OF_A_DRIVE = {'pmsm': 'estimator_pkg.observers.pmsm.observer'}
CHANNEL = ('take', 'write_estimate', 'write_deviation', 'message', 'deviations', 'batch')
DRIVE_CHANNEL = ('take', 'write_estimate', 'write_deviation', 'batch', 'trace')
MECHANISM = 'estimator_pkg.observers.mechanism'
MODELS = {
    name: f'estimator_pkg.models.{name}'
    for name in ('cart_pendulum', 'robotic_leg', 'single_joint', 'two_links')
}
OF_A_MECHANISM = {  # observers of mechanisms with a model; `velocity` is hgo and ehgo
    f'{name}_{model}': f'{MECHANISM}.{name} model={module}'
    for name in ('geso', 'smo', 'velocity')
    for model, module in MODELS.items()
    if (name, model) != ('geso', 'two_links')  # it has no Psi
}
FUNCTIONS = {  # of an observer, by the module of its channel
    'estimator_pkg.driver.channel': (OF_AN_ANGLE, CHANNEL),
    'estimator_pkg.driver.drive_channel': (OF_A_DRIVE, DRIVE_CHANNEL),
    'estimator_pkg.driver.mechanism_channel': (OF_A_MECHANISM, ('take', 'write_estimate', 'batch')),
}
SMOOTHER = 'estimator_pkg.evaluation.reference.smoother'
LOOPS = {  # functions of a module whose arguments are numbers, arrays and records
    f'{SMOOTHER}.cells': ('along', 'filtered', 'used'),
    f'{SMOOTHER}.steps': ('backward', 'forward', 'likelihood'),
    'estimator_pkg.sensor.faults': ('find_faults',),
    'sim_pkg.pmsm.drive': ('simulate',),
}


def loop_name(module: str, function: str) -> str:
    """Return the name of a loop in C."""
    return f'{module.rpartition(".")[2]}_{function}'


ENTRIES: tuple[Entry, ...] = (
    *(
        Entry(channel, function, {'observer': module}, f'{name}_{function}')
        for channel, (observers, functions) in FUNCTIONS.items()
        for name, module in observers.items()
        for function in functions
    ),
    *(
        Entry(
            'estimator_pkg.driver.channel',
            'inform',
            {'observer': OF_AN_ANGLE[name]},
            f'{name}_inform',
        )
        for name in INFORMED
    ),
    *(
        Entry(module, function, {}, loop_name(module, function))
        for module, functions in LOOPS.items()
        for function in functions
    ),
    *(
        Entry(f'{MECHANISM}.motion', 'course', {'model': module}, f'{name}_course')
        for name, module in MODELS.items()
    ),
)
