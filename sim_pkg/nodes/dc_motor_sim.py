"""The executable `dc_motor_sim`: the simulator `dc_motor`, live.

To run it in an executor of your own, give `sim_pkg.joints.dc_motor.SIMULATOR` to a
`sim_pkg.nodes.simulator_node.SimulatorNode`.
"""

import sys

from sim_pkg.nodes.executable import executable

main = executable('dc_motor_sim', 'sim_pkg.joints.dc_motor')

if __name__ == '__main__':
    sys.exit(main())
