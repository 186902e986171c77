"""The executable `pmsm_observer`: currents and voltages in, speed, angle and flux out.

Import the node's class `PmsmObserver` from here to add it to an executor of your own.
"""

import sys

from estimator_pkg.nodes.runtime import executable

main, __getattr__ = executable('estimator_pkg.nodes.pmsm_node', 'PmsmObserver')

if __name__ == '__main__':
    sys.exit(main())
