"""Expected losses from standard deviations, and the calibration of estimates.

The calibration is measured on relevant cells that were not observed.

For a disease, the calibration concerns the probability that a plant is sick. This probability is the class
probability if the estimate has one, or else follows from a normal distribution of value and deviation.

- The Brier score is the mean squared error of the probability (Brier 1950).
- The log loss is the mean negative log likelihood.
- The expected calibration error is the distance between the fraction of sick plants and the mean probability,
averaged over ten bins of the probability by their numbers of plants (Naeini et al. 2015).
- Two fractions concern the set of plants that may be sick
(`sensors.scoring.information.InformationModel.may_be_sick`). The set should have 90 % of the sick plants; its
cost is the fraction of the healthy plants in the set. Only sick plants count for the 90 %, because a set with
90 % of all plants may contain no sick plant (class-conditional conformal predictors, Vovk 2012).

For a continuous field, the measures are the fraction of cells whose truth is in the 90 % interval of a normal
distribution, and the mean squared error divided by the mean variance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import log
from sensors.errors import EstimatorError
from sensors.fields import FieldSet
from sensors.scoring.information import InformationModel, column_strips, least_sick
from sensors.scoring.score import ScoreWeights


def loss_of_deviation(
    uncertainty: NDArray[np.float32],
    weights: ScoreWeights,
    out: NDArray[np.float32] | None = None,
    *,
    first: int = 0,
) -> NDArray[np.float32]:
    """Return the expected loss if the truth is distributed symmetrically about the estimate.

    Half of the expected squared error s^2 is from estimates above the truth, half from estimates below::

        E[c] = (c_above + c_below) / 2 * s^2

    `first` is the index in `weights` of the first field of `uncertainty`. The result is written to `out` if
    it is given, because a new array for a large farm takes longer than the sums.

    Examples
    --------
    >>> from sensors.scoring.score import PAPER_WEIGHTS
    >>> loss_of_deviation(np.full((3, 1, 1), 0.5, np.float32), PAPER_WEIGHTS).ravel().tolist()
    [1.375, 1.375, 0.25]
    """
    costs = (
        0.5 * (np.array(weights.too_healthy) + np.array(weights.too_sick))[first : first + len(uncertainty)]
    )
    loss: NDArray[np.float32] = np.square(uncertainty, out=out)
    loss *= costs.astype(np.float32)[:, None, None]
    return loss


SICK_BELOW = 0.75
"""A value below this threshold is closer to infected (0.5) than to healthy (1)."""
_NORMAL_90 = 1.6449
_BINS = 10
_LEAST = 1e-6
Floats = NDArray[np.float64]


def calibration(
    model: InformationModel,
    truth: NDArray[np.floating],
    unseen: NDArray[np.bool_],
    fields: FieldSet,
    *,
    states_deviation: bool = True,
) -> dict[str, float]:
    """Return the calibration measures of a model, field by field.

    Parameters
    ----------
    model : InformationModel
        The estimate.
    truth : float[n, W, H]
        The true values.
    unseen : bool[n, W, H]
        The cells on which to measure, which are relevant and were not observed.
    fields : FieldSet
        The fields, in the order of the arrays.
    states_deviation : bool
        Whether the uncertainty is a standard deviation. If not, only diseases with class probabilities count.

    Returns
    -------
    dict of str to float
        A disease NAME has ``NAME_brier``, ``NAME_log_loss``, ``NAME_ece``, ``NAME_sick_held`` and
        ``NAME_healthy_held``. A continuous field has ``NAME_held`` and ``NAME_error`` (squared error over
        variance). An undefined measure is left out, such as ``NAME_sick_held`` if no plant is sick.

    Raises
    ------
    EstimatorError
        If shapes differ.
    """
    if not model.value.shape == truth.shape == unseen.shape:
        shapes = f"model {model.value.shape}, truth {truth.shape}, cells {unseen.shape}"
        raise EstimatorError(f"calibration: {shapes} differ in shape")
    found: dict[str, float] = {}
    for k, field in enumerate(fields):
        cells = unseen[k]
        known = model.probabilities is not None and field.name in model.probabilities
        if not cells.any() or not (known or states_deviation):
            continue
        right = truth[k][cells].astype(np.float64)
        if field.kind == "disease":
            sick = probability_of_sick(model, k, cells)
            figures = of_classes(sick, right < SICK_BELOW)
        else:
            figures = of_normal(right, model.value[k][cells], model.uncertainty[k][cells])
        found |= {f"{field.name}_{name}": value for name, value in figures.items() if np.isfinite(value)}
    return found


def probability_of_sick(model: InformationModel, k: int, cells: NDArray[np.bool_]) -> Floats:
    """Return the probability that each plant is sick (see the module's docstring), float64[n]."""
    name = model.fields[k]
    if model.probabilities is not None and name in model.probabilities:
        healthy = np.concatenate(
            [
                model.probabilities_in(name, columns)[0][cells[columns]]
                for columns in column_strips(len(cells))
            ]
        )
        return 1.0 - healthy.astype(np.float64)
    from scipy.special import ndtr

    away = (SICK_BELOW - model.value[k][cells]) / np.maximum(model.uncertainty[k][cells], _LEAST)
    return ndtr(away.astype(np.float64))


def of_classes(probability: NDArray[np.floating], sick: NDArray[np.bool_]) -> dict[str, float]:
    """Return the calibration measures of the probabilities, float[n], that plants are sick.

    Examples
    --------
    >>> figures = of_classes(np.array([0.9, 0.9, 0.1, 0.1]), np.array([True, True, False, False]))
    >>> {name: round(value, 3) for name, value in figures.items()}
    {'brier': 0.01, 'log_loss': 0.105, 'ece': 0.1, 'sick_held': 1.0, 'healthy_held': 0.0}
    """
    p, is_sick = probability.astype(np.float64), sick.astype(np.float64)
    bins = np.minimum((p * _BINS).astype(np.intp), _BINS - 1)
    gaps = np.bincount(bins, p - is_sick, _BINS)
    likely = np.where(sick, p, 1.0 - p)
    held = p >= least_sick(probability)
    return {
        "brier": float(np.mean((p - is_sick) ** 2)),
        "log_loss": float(-np.mean(log(np.maximum(likely, _LEAST)))),
        "ece": float(np.abs(gaps).sum() / len(p)),
        "sick_held": float(held[sick].mean()) if sick.any() else float("nan"),
        "healthy_held": float(held[~sick].mean()) if not sick.all() else float("nan"),
    }


def of_normal(
    truth: NDArray[np.floating], value: NDArray[np.floating], deviation: NDArray[np.floating]
) -> dict[str, float]:
    """Return the calibration measures of normal distributions with these means and deviations, float[n].

    Examples
    --------
    >>> of_normal(np.array([0.0, 2.0]), np.zeros(2), np.ones(2))
    {'held': 0.5, 'error': 2.0}
    """
    off, variance = (
        np.abs(truth - value.astype(np.float64)),
        float(np.mean(np.square(deviation, dtype=float))),
    )
    error = float(np.mean(off**2)) / variance if variance > 0.0 else float("nan")
    return {"held": float(np.mean(off <= _NORMAL_90 * deviation)), "error": error}
