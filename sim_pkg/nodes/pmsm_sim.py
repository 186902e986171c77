"""The executable `pmsm_sim`: the simulator `pmsm`, live.

To run it in an executor of your own, give `sim_pkg.pmsm.simulator.SIMULATOR` to a
`sim_pkg.nodes.simulator_node.SimulatorNode`.
"""

import sys

from sim_pkg.nodes.executable import executable

main = executable('pmsm_sim', 'sim_pkg.pmsm.simulator')

if __name__ == '__main__':
    sys.exit(main())
