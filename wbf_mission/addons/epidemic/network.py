"""Small neural networks for class probabilities, in numpy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.linear_algebra import exp, product
from wbf_mission.addons.epidemic.features import (
    N_FEATURES,
    N_LOCAL,
    context_features,
    local_features,
    overall_features,
)

Floats32 = NDArray[np.float32]

_BATCH = 512
_CHUNK_ROWS = 8192
_WARM_UP_STEPS = 200
_MOMENTS = (0.9, 0.99)
_DECAY = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """A multilayer perceptron with rectified linear units and a softmax output.

    >>> network = Network((np.zeros((2, 3), np.float32),), (np.zeros(3, np.float32),))
    >>> network.probabilities(np.ones((1, 2), np.float32)).round(3).tolist()
    [[0.3330000042915344, 0.3330000042915344, 0.3330000042915344]]
    """

    weights: tuple[Floats32, ...]  # Weight matrix of each layer, float32[n, m].
    biases: tuple[Floats32, ...]  # Bias vector of each layer, float32[m].
    further: tuple[Network, ...] = ()
    """Refinement networks, whose inputs include the output of the previous network (see `features`)."""

    @classmethod
    def draw(cls, sizes: Sequence[int], rng: Generator) -> Network:
        """Return randomly initialised layers with these sizes, beginning with the number of inputs."""
        shapes = list(itertools.pairwise(sizes))
        weights = [
            (rng.standard_normal(shape) * np.sqrt(2.0 / shape[0])).astype(np.float32) for shape in shapes
        ]
        weights[-1] *= np.float32(0.1)
        return cls(tuple(weights), tuple(np.zeros(shape[1], np.float32) for shape in shapes))

    def probabilities(self, inputs: Floats32) -> Floats32:
        """Return the class probabilities for rows of inputs, float32[rows, classes]."""
        out = np.empty((len(inputs), len(self.biases[-1])), np.float32)
        for start in range(0, len(inputs), _CHUNK_ROWS):
            part = slice(start, start + _CHUNK_ROWS)
            out[part] = self._forward(inputs[part])[-1]
        return out

    def _forward(self, inputs: Floats32) -> list[Floats32]:
        """Return the input of each layer, followed by the class probabilities."""
        values = product(inputs, self.weights[0])
        values += self.biases[0]
        return [inputs, *self.after_first([values])]

    def after_first(self, layers: list[Floats32]) -> list[Floats32]:
        """Return all layers and the class probabilities; `layers` is changed in place."""
        for weight, bias in zip(self.weights[1:], self.biases[1:], strict=True):
            np.maximum(layers[-1], 0.0, out=layers[-1])
            values = product(layers[-1], weight)
            values += bias
            layers.append(values)
        scores = layers[-1]
        scores -= np.maximum.reduce(list(scores.T))[:, None]
        exp(scores, out=scores)
        scores /= np.add.reduce(list(scores.T))[:, None]
        return layers

    def _gradients(
        self, inputs: Floats32, classes: NDArray[np.integer], sample_weights: Floats32
    ) -> list[Floats32]:
        layers = self._forward(inputs)
        slope = layers[-1]
        slope[np.arange(len(inputs)), classes] -= 1.0
        slope *= (sample_weights / np.float32(len(inputs)))[:, None]
        of_weights: list[Floats32] = []
        of_biases: list[Floats32] = []
        for number in range(len(self.weights) - 1, -1, -1):
            of_weights.append(product(layers[number].T, slope))
            of_biases.append(slope.sum(axis=0))
            if number:
                slope = product(slope, self.weights[number].T) * (layers[number] > 0.0)
        return of_weights[::-1] + of_biases[::-1]


def train(
    network: Network,
    inputs: Floats32,
    classes: NDArray[np.integer],
    sample_weights: Floats32,
    *,
    epochs: int,
    learning_rate: float = 2e-3,
    rng: Generator,
) -> None:
    """Minimise the weighted cross entropy with Adam (Kingma & Ba 2015) and a cosine schedule, in place."""
    parameters = [*network.weights, *network.biases]
    means = [np.zeros_like(parameter) for parameter in parameters]
    squares = [np.zeros_like(parameter) for parameter in parameters]
    size = min(_BATCH, max(len(inputs), 1))
    batches = len(inputs) // size
    fade_mean, fade_square = (np.float32(1.0 - moment) for moment in _MOMENTS)
    step = 0
    for _ in range(epochs):
        order = rng.permutation(len(inputs))
        for start in range(0, batches * size, size):
            rows = order[start : start + size]
            gradients = network._gradients(inputs[rows], classes[rows], sample_weights[rows])
            step += 1
            cosine = 0.5 + 0.5 * math.cos(math.pi * step / (epochs * batches))
            rate = learning_rate * min(1.0, step / _WARM_UP_STEPS) * cosine
            corrected = rate / (1.0 - _MOMENTS[0] ** step)
            root = 1.0 / np.sqrt(1.0 - _MOMENTS[1] ** step)
            for parameter, gradient, mean, square in zip(parameters, gradients, means, squares, strict=True):
                mean += fade_mean * (gradient - mean)
                square += fade_square * (gradient * gradient - square)
                parameter -= np.float32(corrected) * mean / (np.float32(root) * np.sqrt(square) + 1e-8)
                parameter -= np.float32(rate * _DECAY) * parameter


Cells = NDArray[np.intp]


class FieldClassifier:
    """Class probabilities of all host cells, refined by all refinement networks and updated incrementally.

    The contribution of a cell's rings to the first layers is cached, and recomputed only for cells near a new
    observation. The features of the whole field contribute equally to every cell.

    `codes` is not copied. The host cells `x`, `y` are in C order. `day` counts from the network's first day.
    """

    def __init__(
        self, network: Network, codes: NDArray[np.uint8], x: Cells, y: Cells, seeds: int, day: int
    ) -> None:
        self._stages = (network, *network.further)
        self._codes, self._x, self._y = codes, x, y
        self._seeds, self._day = seeds, day
        self._local = [np.empty((len(x), stage.weights[0].shape[1]), np.float32) for stage in self._stages]
        self.touch(np.arange(len(x)))

    def touch(self, rows: Cells) -> None:
        """Recompute the ring features of the cells `rows` after a change of the codes."""
        local = local_features(self._codes, self._x[rows], self._y[rows])
        for kept, stage in zip(self._local, self._stages, strict=True):
            kept[rows] = product(local, stage.weights[0][:N_LOCAL])

    def probabilities(self, overall: Floats32 | None = None, found: Floats32 | None = None) -> Floats32:
        """Return the class probabilities of the cells, float32[n, 3], regardless of the cells' readings.

        `overall` are the features of the whole field; None computes them. `found` are the probabilities of
        the previous network; they are given only if this classifier has no first network.
        """
        if overall is None:
            overall = overall_features(self._codes, len(self._x), self._seeds, self._day)
        for kept, stage in zip(self._local, self._stages, strict=True):
            first = stage.weights[0]
            values = kept + (product(overall, first[N_LOCAL:N_FEATURES]) + stage.biases[0])
            if found is not None:
                context = context_features(self._codes, self._x, self._y, found, self._seeds)
                values += product(context, first[N_FEATURES:])
            found = stage.after_first([values])[-1]
        assert found is not None
        return found
