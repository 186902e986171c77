# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A log as CSV: its velocity with the 95 % interval, and a plot.

    python docs/examples/log.py log.png

log.csv has the time [s] and the counts of an encoder with 4096 counts per turn.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from estimator_pkg import VelocityEstimator

log = np.genfromtxt(Path(__file__).with_name('log.csv'), delimiter=',', names=True)
quantum = 2.0 * np.pi / 4096
estimates = VelocityEstimator(quantum=quantum).run(log['time'], quantum * log['count'])
low = estimates.velocity - 1.96 * estimates.velocity_stddev
high = estimates.velocity + 1.96 * estimates.velocity_stddev

plt.fill_between(log['time'], low, high, alpha=0.3, label='95 % interval')
plt.plot(log['time'], estimates.velocity, label='velocity')
plt.gca().set(xlabel='time [s]', ylabel='velocity [rad/s]', ylim=(-3.0, 3.0))
plt.legend()
plt.savefig(sys.argv[1])
