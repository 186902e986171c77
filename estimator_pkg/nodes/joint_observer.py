"""The executable `joint_observer`: angles in, velocities out.

Import the node's class `JointObserver` from here to add it to an executor of your own.
"""

import sys

from estimator_pkg.nodes.runtime import executable

main, __getattr__ = executable('estimator_pkg.nodes.joint_node', 'JointObserver')

if __name__ == '__main__':
    sys.exit(main())
