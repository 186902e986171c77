"""The executable `robotic_leg_sim`: the simulator `robotic_leg`, live.

To run it in an executor of your own, give `sim_pkg.mechanisms.robotic_leg.SIMULATOR` to a
`sim_pkg.nodes.simulator_node.SimulatorNode`.
"""

import sys

from sim_pkg.nodes.executable import executable

main = executable('robotic_leg_sim', 'sim_pkg.mechanisms.robotic_leg')

if __name__ == '__main__':
    sys.exit(main())
