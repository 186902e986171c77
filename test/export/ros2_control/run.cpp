// Copyright 2026 velocity_estimator contributors
// SPDX-License-Identifier: Apache-2.0

/// Runs the observers of a written package without ROS: a line in is a pause ("p") or an update
/// (time [ns], period [ns], positions); a line out has the six values of each joint, then its counts.

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>

#include "joint_velocity/observers.hpp"

using namespace joint_velocity_controller;

int main(int count, char ** words)
{
  Observers observers({words + 2, words + count}, std::atof(words[1]));
  std::vector<double> positions(static_cast<std::size_t>(count) - 2);
  std::string line, word;
  while (std::getline(std::cin, line)) {
    std::istringstream in(line);
    in >> word;
    if (word == "p") {
      observers.pause();
    } else {
      const int64_t time_ns = std::stoll(word);
      in >> word;
      const int64_t period_ns = std::stoll(word);
      for (auto & position : positions) {
        in >> word;
        position = std::strtod(word.c_str(), nullptr);
      }
      observers.update(time_ns, period_ns, positions);
    }
    for (std::size_t k = 0; k < positions.size(); ++k) {
      const auto & now = observers.estimate(k);
      const auto & of = observers.counts(k);
      std::printf(
        "%a %a %a %a %a %a %zu %zu %zu ", now.position, now.velocity, now.acceleration,
        now.position_stddev, now.velocity_stddev, now.status, std::size_t(of.used),
        std::size_t(of.missing), std::size_t(of.dropped));
    }
    std::puts("");
  }
}
