# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare drives sample by sample: their batches contain truth and estimate of every sample.

If a bag has the truth of every sample, the electrical joint is compared per sample: a second of a
drive then counts as much as thousands of messages of another joint. The mechanical joint keeps one
state per batch.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.options import SMOOTHER, TRUTH, Options
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.streams.drive import ELECTRICAL

TRUE_SAMPLES = '/ground_truth/samples'
BATCH_SUFFIX = '_samples'  # suffix of the topic of estimates


def available(bag: Bag, options: Options) -> bool:
    """Return True if the bag has the truth of every sample, and no other truth is requested."""
    return (
        options.truth is None
        and options.reference != SMOOTHER
        and TRUTH in bag.topics
        and _there(bag, TRUE_SAMPLES)
    )


def finer(bag: Bag, topic: str, series: Mapping[str, Series]) -> dict[str, Series]:
    """Return the series, with the electrical joint taken from the batches of `topic` if possible.

    Raises
    ------
    UserError : a message there is not a batch.
    """
    electrical = [joint for joint in series if joint.endswith(ELECTRICAL)]
    if len(electrical) != 1 or not _there(bag, topic):
        return dict(series)
    bag.require(topic)
    try:
        batches = [drive_samples.decode(bytes(message.raw)) for message in bag.messages([topic])]
    except MalformedMessageError as error:
        raise UserError(f'{topic} of {bag.path}: {error}') from None
    stamps = np.concatenate([batch.stamps_ns for batch in batches])
    values = np.concatenate([batch.values for batch in batches])
    valid = values[:, 3] > 0.5
    nothing = np.broadcast_to(np.nan, int(np.count_nonzero(valid)))
    return {
        **series,
        electrical[0]: Series(stamps[valid], values[valid, 0], values[valid, 1], nothing),
    }


def _there(bag: Bag, topic: str) -> bool:
    found = bag.topics.get(topic)
    return found is not None and found.type == drive_samples.TYPE and found.count > 0
