# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

r"""A firmware's log as CSV into a bag that `velocity_estimator evaluate` reads.

    python docs/examples/firmware_csv.py LOG.csv BAG [--joint NAME]

The first row has the names: stamp_ns, angle (as it was passed to update), and of the estimate
position, velocity, position_stddev, velocity_stddev. A row whose velocity is empty or nan has no
estimate.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from pathlib import Path

from estimator_pkg import whole_file
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.errors import UserError
from estimator_pkg.messages import joint_state

NAMES = ('stamp_ns', 'angle', 'position', 'velocity', 'position_stddev', 'velocity_stddev')
MEASUREMENT, NODE = '/joint_states', '/firmware'


def rows(path: Path) -> list[tuple[int, list[float]]]:
    """Return stamp and numbers of each row; raise UserError with the missing name, or the line."""
    table = csv.DictReader(whole_file.read_text(path).removeprefix('\ufeff').splitlines())
    missing = [name for name in NAMES if name not in (table.fieldnames or ())]
    if missing:
        raise UserError(f"{path} has no column '{missing[0]}', only {table.fieldnames}")
    try:
        return [
            (int(row['stamp_ns']), [float(row[name] or math.nan) for name in NAMES[1:]])
            for row in table
        ]
    except (TypeError, ValueError) as error:
        raise UserError(f'{path}, line {table.line_num}: {error}') from None


def main() -> int:
    """Run the script; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('log', type=Path)
    parser.add_argument('bag', type=Path)
    parser.add_argument('--joint', default='joint')
    given = parser.parse_args()
    try:
        found = rows(given.log)
        encoder, topics = joint_state.Encoder(), (MEASUREMENT, f'{NODE}/estimate')
        with BagWriter(given.bag) as bag:
            for topic in (*topics, f'{NODE}/estimate_stddev'):
                bag.add_topic(topic, joint_state.TYPE)
            for stamp, (angle, position, velocity, *stddevs) in found:
                written = [(MEASUREMENT, angle, [])]
                if math.isfinite(velocity):
                    written += [(topics[1], position, [velocity])]
                    written += [(f'{NODE}/estimate_stddev', stddevs[0], [stddevs[1]])]
                for topic, at, speeds in written:
                    raw = encoder.encode(stamp, '', [given.joint], [at], speeds, [])
                    bag.write(topic, stamp, raw)
    except (UserError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f'{given.bag}: {len(found)} samples; velocity_estimator evaluate {given.bag}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
