"""The executable `adaptive_observer`: velocities of joints whose parameters are not known.

Import the node's class `AdaptiveObserver` from here to add it to an executor of your own.
"""

import sys

from estimator_pkg.nodes.runtime import executable

main, __getattr__ = executable('estimator_pkg.nodes.adaptive_node', 'AdaptiveObserver')

if __name__ == '__main__':
    sys.exit(main())
