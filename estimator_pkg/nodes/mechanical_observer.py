"""The executable `mechanical_observer`: velocities where the mechanism and its inputs are known.

Import the node's class `MechanicalObserver` from here to add it to an executor of your own.
"""

import sys

from estimator_pkg.nodes.runtime import executable

main, __getattr__ = executable('estimator_pkg.nodes.mechanical_node', 'MechanicalObserver')

if __name__ == '__main__':
    sys.exit(main())
