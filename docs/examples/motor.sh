#!/bin/sh
# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0
#
# A motor without an encoder: from a bag of its currents and voltages to the tuned node.
#
#     sh docs/examples/motor.sh           # files are written into the current folder; Ctrl-C ends it
#
# The bag is simulated here. Record yours: velocity_estimator record /drive_samples --out motor_bag
set -eu
MOTOR=$(dirname "$0")/../../config/pmsm_motor_servo_400w.yaml

velocity_estimator simulate pmsm --params "$MOTOR" --duration 2 --out motor_bag

# Are stamps, wiring, flux linkage and resistance right?
velocity_estimator doctor motor_bag --params "$MOTOR"

velocity_estimator tune motor_bag --observer pmsm --params "$MOTOR" --out motor_tuned.yaml

# The node, and the bag in place of the drive.
velocity_estimator play motor_bag --clock --loop > play.log &
trap 'kill $!' EXIT
pmsm_observer --ros-args --params-file motor_tuned.yaml -p use_sim_time:=true
