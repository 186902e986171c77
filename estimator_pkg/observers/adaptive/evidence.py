# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Standard deviations of the adaptive observer's parameters, and trust in the model.

The observer sums, over the samples that it learnt from,

    psi psi^T,  psi target,  samples,  slow_e^2,  slow_bend^2

where psi multiplies the free parameters and the target is the value that psi theta must equal.
slow_e is the innovation, which predicts each sample before it is used. slow_bend is the
acceleration. Both pass the observer's filters and one more low-pass. This module cuts the sums into
blocks of equal learning time and keeps only the blocks: at most MOST_BLOCKS, then neighbours merge.

The standard deviation is that of the delete-one-block jackknife. It includes errors that are
correlated within a block (quantisation, friction, the motion itself), which the formula for
independent errors leaves out. It is computed for blocks of growing length, and the largest is used.
Three errors are added: the bias from measurement noise in psi, the error of the sampling, and the
distance between the parameters and the least-squares solution of the blocks (if the gradient has
not converged yet, or a bound is active).

B. Efron, "The jackknife, the bootstrap and other resampling plans" (1982); blocks: H. R. Kuensch,
Annals of Statistics 17 (1989).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.adaptive.state import LearningSums

Array = NDArray[np.float64]

BLOCK_TIME = 0.25  # shortest learning time of a block [s], ...
MEMORIES = 4.0  # ... and in time constants of the slowest filter
MERGING_BLOCKS = 64  # number of blocks at which neighbours merge
EVIDENCE_BLOCKS = 8  # smallest number of blocks for a standard deviation
OLDEST_BLOCK = 4.0  # memories of least squares after which a block is forgotten
SINGULAR = 1e-13  # reciprocal condition of the scaled matrix below which it counts as singular


class LearningBlock(NamedTuple):
    """Sums over an interval of learning; shapes (m, m), (m,), (3,)."""

    matrix: Array
    vector: Array
    sums: Array


class Evidence:
    """The blocks of one joint.

    Parameters
    ----------
    slowest : magnitude of the slowest observer pole [1/s].
    memory : memory of least squares [s]; 0: it forgets nothing.

    Attributes
    ----------
    length : learning time in a block [s]; doubles when blocks merge.
    """

    def __init__(self, slowest: float, memory: float = 0.0) -> None:
        self.shortest = self.length = max(BLOCK_TIME, MEMORIES / slowest)
        self.memory = memory
        self.blocks: list[LearningBlock] = []
        self._until = 0.0
        self._last: LearningBlock | None = None
        self._answer: _Answer | None = None

    def look(self, adapted: float, sums: LearningSums) -> None:
        """Take the observer's sums after a learning time of `adapted` [s]."""
        if adapted < self._until:  # the observer started again
            self.length, self.blocks, self._until, self._last = self.shortest, [], 0.0, None
            self._answer = None
        if adapted - self._until < self.length:
            return
        self._answer = None
        newest = LearningBlock(
            sums.matrix, sums.vector, np.array((sums.count, sums.of_e, sums.of_bend))
        )
        block = newest
        if self._last is not None:
            block = LearningBlock(*(now - then for now, then in zip(newest, self._last)))
        self._until, self._last = adapted, newest
        self.blocks.append(block)
        if self.memory > 0.0:
            keep = math.ceil(OLDEST_BLOCK * self.memory / self.length)
            del self.blocks[:-keep]
        if len(self.blocks) >= MERGING_BLOCKS:
            pairs = zip(self.blocks[::2], self.blocks[1::2])
            self.blocks = [LearningBlock(*map(np.add, *pair)) for pair in pairs]
            self.length *= 2.0

    @property
    def enough(self) -> bool:
        """True if there are enough blocks for a standard deviation."""
        return len(self.blocks) >= EVIDENCE_BLOCKS

    def answer(self) -> _Answer | None:
        """Return the least-squares solution of all blocks; None if the matrix is singular.

        The result is cached until the next block.
        """
        if self._answer is None and self.enough:
            age = self.length * np.arange(len(self.blocks) - 1, -1, -1)
            weights = np.exp(-age / self.memory) if self.memory > 0.0 else np.ones(len(age))
            self._answer = _answer(self.blocks, weights)
        return self._answer


class _Answer(NamedTuple):
    """Least squares over all blocks."""

    inverse: Array  # of the normal matrix, shape (m, m)
    own: Array  # the solution, shape (m,)
    covariance: Array  # of the solution, by the jackknife, shape (m, m)
    samples: float  # number of samples
    slow_e: float  # mean squares in the newer half of the blocks [rad^2]
    slow_bend: float


def _answer(blocks: list[LearningBlock], weights: Array) -> _Answer | None:
    matrices = weights[:, None, None] * np.array([block.matrix for block in blocks])
    vectors = weights[:, None] * np.array([block.vector for block in blocks])
    total = matrices.sum(axis=0)
    scale = np.sqrt(np.diag(total))
    if not np.all(scale > 0.0) or 1.0 / np.linalg.cond(total / np.outer(scale, scale)) < SINGULAR:
        return None
    inverse = np.linalg.inv(total)
    # the newer half only: in the older one the parameters were still converging
    sums = np.sum([block.sums for block in blocks[len(blocks) // 2 :]], axis=0)
    return _Answer(
        inverse,
        inverse @ vectors.sum(axis=0),
        _largest(matrices, vectors),
        float(weights @ [block.sums[0] for block in blocks]),
        float(sums[1] / sums[0]),
        float(sums[2] / sums[0]),
    )


class Assessment(NamedTuple):
    """The assessment of the free parameters."""

    covariance: Array  # of theta, shape (m, m), including bias, sampling error and distance
    # error of each parameter that would explain the unexplained motion by itself, shape (m,); 0 if
    # noise explains the innovation
    hidden: Array
    scale: Array  # value at which each parameter by itself would cause the acceleration, shape (m,)
    explained: float  # part of the acceleration's power that is predicted, or noise
    noise_only: bool  # measurement noise explains all of the innovation


def judge(
    evidence: Evidence, theta: Array, bias: Array, sampling: Array, noise: float, doubt: float
) -> Assessment | None:
    """Return the assessment of `theta`; None if the blocks do not determine it.

    Parameters
    ----------
    theta : the free parameters, shape (m,).
    bias : bias of psi target from the noise in psi, per sample, shape (m,).
    sampling : error of theta from the sampling, shape (m,).
    noise : mean square of slow_e that measurement noise explains [rad^2].
    doubt : factor on `noise` up to which noise explains all of the innovation.
    """
    answer = evidence.answer()
    if answer is None:
        return None
    inverse, own, covariance, samples, slow_e, slow_bend = answer
    for error in (theta - own, inverse @ bias * samples):
        covariance = covariance + np.outer(error, error)
    covariance = covariance + np.diag(sampling * sampling)
    noise_only = slow_e <= doubt * noise
    unexplained = 0.0 if noise_only else slow_e
    size = np.sqrt(np.diag(np.linalg.inv(inverse)))
    return Assessment(
        covariance,
        np.sqrt(unexplained * samples * np.diag(inverse)),
        np.sqrt(slow_bend * samples) / size,
        1.0 - max(0.0, slow_e - noise) / slow_bend if slow_bend > 0.0 else 0.0,
        noise_only,
    )


def _largest(matrices: Array, vectors: Array) -> Array:
    """Return the jackknife's covariance at the block length where it is largest."""
    best = _jackknife(matrices, vectors)
    while len(matrices) >= 2 * EVIDENCE_BLOCKS:
        odd = len(matrices) % 2  # the oldest block is not merged
        matrices = np.concatenate([matrices[:odd], matrices[odd::2] + matrices[odd + 1 :: 2]])
        vectors = np.concatenate([vectors[:odd], vectors[odd::2] + vectors[odd + 1 :: 2]])
        other = _jackknife(matrices, vectors)
        if np.sum(np.diag(other) / np.diag(best)) > len(best):
            best = other
    return best


def _jackknife(matrices: Array, vectors: Array) -> Array:
    """Return the covariance of the solution, from the solutions without one block each."""
    count = len(matrices)
    left = matrices.sum(axis=0) - matrices
    try:
        answers = np.linalg.solve(left, (vectors.sum(axis=0) - vectors)[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:  # only one block determines a parameter
        return np.diag([math.inf] * matrices.shape[1])
    away = answers - answers.mean(axis=0)
    return (count - 1.0) / count * away.T @ away
