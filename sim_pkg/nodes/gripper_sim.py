"""The executable `gripper_sim`: the simulator `gripper`, live.

To run it in an executor of your own, give `sim_pkg.joints.gripper.SIMULATOR` to a
`sim_pkg.nodes.simulator_node.SimulatorNode`.
"""

import sys

from sim_pkg.nodes.executable import executable

main = executable('gripper_sim', 'sim_pkg.joints.gripper')

if __name__ == '__main__':
    sys.exit(main())
