"""What the data say of the adaptive observer's parameters: how sure, and whether the model fits.

The observer sums, over the samples that it learnt from,

    psi psi^T,  psi target,  (samples, slow_e^2, slow_bend^2)

where psi multiplies the free parameters, the target is what they have to explain, slow_e is the
innovation (a prediction from what was known before, so always of data not yet used) and slow_bend
the acceleration, both after the observer's filters and one more low-pass. Here these sums are cut
into blocks of equal learning time, which are all that is kept: at most MOST, then neighbours merge.

The standard deviation is that of the delete-one-block jackknife: whatever is correlated within a
block (quantisation, friction, the motion itself) is in it, which the formula for independent errors
leaves out. It is taken over blocks of growing length, and the largest counts. To it come the bias
that noise of the reading in psi makes, what the sampling costs, and how far the parameters are from
the blocks' own answer (the gradient has not arrived, or a bound acts).

B. Efron, "The jackknife, the bootstrap and other resampling plans" (1982); blocks: H. R. Kuensch,
Annals of Statistics 17 (1989).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHORTEST = 0.25  # [s] of learning in a block, ...
MEMORIES = 4.0  # ... and time constants of the slowest filter, at least
MOST = 64  # blocks
FEWEST = 8  # blocks for a standard deviation
OLD = 4.0  # memories of least squares after which a block is forgotten
SINGULAR = 1e-13  # reciprocal condition, of the scaled matrix, of what cannot be solved


class Block(NamedTuple):
    """Sums over a stretch of learning; shapes (m, m), (m,), (3,)."""

    matrix: Array
    vector: Array
    sums: Array


class Evidence:
    """Blocks of one joint.

    Parameters
    ----------
    slowest : magnitude of the slowest observer pole [1/s].
    memory : of least squares [s]; 0: it forgets nothing.

    Attributes
    ----------
    length : learning time in a block [s]; doubles when blocks merge.
    """

    def __init__(self, slowest: float, memory: float = 0.0) -> None:
        self.shortest = self.length = max(SHORTEST, MEMORIES / slowest)
        self.memory = memory
        self.blocks: list[Block] = []
        self._until = 0.0
        self._last: Block | None = None
        self._answer: _Answer | None = None

    def look(self, adapted: float, sums: tuple) -> None:
        """Take in what the observer has summed in so much learning time [s]."""
        if adapted < self._until:  # it started again
            self.length, self.blocks, self._until, self._last = self.shortest, [], 0.0, None
            self._answer = None
        if adapted - self._until < self.length:
            return
        self._answer = None
        newest = Block(np.array(sums[0]), np.array(sums[1]), np.array(sums[2]))
        block = newest if self._last is None else _minus(newest, self._last)
        self._until, self._last = adapted, newest
        self.blocks.append(block)
        if self.memory > 0.0:
            keep = math.ceil(OLD * self.memory / self.length)
            del self.blocks[:-keep]
        if len(self.blocks) >= MOST:
            self.blocks = _merged(self.blocks)
            self.length *= 2.0

    @property
    def enough(self) -> bool:
        """True if there is something to say."""
        return len(self.blocks) >= FEWEST

    def answer(self) -> _Answer | None:
        """What the blocks say; None where they determine nothing. Kept until another one comes."""
        if self._answer is None and self.enough:
            age = self.length * np.arange(len(self.blocks) - 1, -1, -1)
            weights = np.exp(-age / self.memory) if self.memory > 0.0 else np.ones(len(age))
            self._answer = _answer(self.blocks, weights)
        return self._answer


class _Answer(NamedTuple):
    """Of least squares over all blocks: inverse of the normal matrix, answer, covariance by the
    jackknife, samples; mean squares of slow_e and slow_bend in the newer half.
    """

    inverse: Array
    own: Array
    covariance: Array
    samples: float
    slow_e: float
    slow_bend: float


def _answer(blocks: list[Block], weights: Array) -> _Answer | None:
    matrices = weights[:, None, None] * np.array([block.matrix for block in blocks])
    vectors = weights[:, None] * np.array([block.vector for block in blocks])
    total = matrices.sum(axis=0)
    scale = np.sqrt(np.diag(total))
    if not np.all(scale > 0.0) or 1.0 / np.linalg.cond(total / np.outer(scale, scale)) < SINGULAR:
        return None
    inverse = np.linalg.inv(total)
    # the older half still has the way to the parameters in its innovation
    sums = np.sum([block.sums for block in blocks[len(blocks) // 2 :]], axis=0)
    return _Answer(
        inverse,
        inverse @ vectors.sum(axis=0),
        _largest(matrices, vectors),
        float(weights @ [block.sums[0] for block in blocks]),
        float(sums[1] / sums[0]),
        float(sums[2] / sums[0]),
    )


class Verdict(NamedTuple):
    """What evidence says of free parameters, shapes (m, m), (m,), (m,).

    covariance : of theta, correlation of the errors, bias and distance included.
    hidden : how much of a parameter could hide in the part of the motion that is not explained, if
        that part went with it alone; 0 where noise explains it.
    scale : size at which a parameter alone would make the whole acceleration.
    explained : part of the acceleration's power that was predicted; noise counts as explained.
    noise_only : the noise of the reading explains all of the innovation.
    """

    covariance: Array
    hidden: Array
    scale: Array
    explained: float
    noise_only: bool


def judge(
    evidence: Evidence, theta: Array, bias: Array, sampling: Array, noise: float, doubt: float
) -> Verdict | None:
    """What the blocks say; None where they determine nothing.

    Parameters
    ----------
    theta : the free parameters, shape (m,).
    bias : of psi target by the noise in psi, per sample, shape (m,).
    sampling : error of theta by the sampling, shape (m,).
    noise : mean square of slow_e that the noise of the reading explains [rad^2].
    doubt : factor on it.
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
    return Verdict(
        covariance,
        np.sqrt(unexplained * samples * np.diag(inverse)),
        np.sqrt(slow_bend * samples) / size,
        1.0 - max(0.0, slow_e - noise) / slow_bend if slow_bend > 0.0 else 0.0,
        noise_only,
    )


def _largest(matrices: Array, vectors: Array) -> Array:
    """The jackknife's covariance at the block length where it is largest."""
    best = _jackknife(matrices, vectors)
    while len(matrices) >= 2 * FEWEST:
        odd = len(matrices) % 2  # the oldest stays alone
        matrices = np.concatenate([matrices[:odd], matrices[odd::2] + matrices[odd + 1 :: 2]])
        vectors = np.concatenate([vectors[:odd], vectors[odd::2] + vectors[odd + 1 :: 2]])
        other = _jackknife(matrices, vectors)
        if np.sum(np.diag(other) / np.diag(best)) > len(best):
            best = other
    return best


def _jackknife(matrices: Array, vectors: Array) -> Array:
    """Covariance of the answer, from the answers without one block each."""
    count = len(matrices)
    left = matrices.sum(axis=0) - matrices
    try:
        answers = np.linalg.solve(left, (vectors.sum(axis=0) - vectors)[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:  # one block carries a parameter alone
        return np.diag([math.inf] * matrices.shape[1])
    away = answers - answers.mean(axis=0)
    return (count - 1.0) / count * away.T @ away


def _merged(blocks: list[Block]) -> list[Block]:
    return [
        Block(a.matrix + b.matrix, a.vector + b.vector, a.sums + b.sums)
        for a, b in zip(blocks[::2], blocks[1::2])
    ]


def _minus(a: Block, b: Block) -> Block:
    return Block(a.matrix - b.matrix, a.vector - b.vector, a.sums - b.sums)
