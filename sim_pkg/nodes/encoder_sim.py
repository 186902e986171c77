"""The executable `encoder_sim`: the simulator `encoder`, live.

To run it in an executor of your own, give `sim_pkg.joints.encoder.SIMULATOR` to a
`sim_pkg.nodes.simulator_node.SimulatorNode`.
"""

import sys

from sim_pkg.nodes.executable import executable

main = executable('encoder_sim', 'sim_pkg.joints.encoder')

if __name__ == '__main__':
    sys.exit(main())
