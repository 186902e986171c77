"""The executable `switched_observer`: velocities of a system that known events switch.

Import the node's class `SwitchedObserver` from here to add it to an executor of your own.
"""

import sys

from estimator_pkg.nodes.runtime import executable

main, __getattr__ = executable('estimator_pkg.nodes.switched_node', 'SwitchedObserver')

if __name__ == '__main__':
    sys.exit(main())
