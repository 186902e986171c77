"""The executable `pendulum_sim`: the simulator `pendulum`, live.

To run it in an executor of your own, give `sim_pkg.mechanisms.pendulum.SIMULATOR` to a
`sim_pkg.nodes.simulator_node.SimulatorNode`.
"""

import sys

from sim_pkg.nodes.executable import executable

main = executable('pendulum_sim', 'sim_pkg.mechanisms.pendulum')

if __name__ == '__main__':
    sys.exit(main())
