"""Coverage and width of our 95 % intervals, compared with Student's.

Pairs of losses over n environments are drawn from synthetic distributions and, with replacement, from the
frozen rows in `results/`; the true ratio of means is known. A mean is treated as a ratio to ones. For each n
the table has the coverage in percent and the median width relative to the true value ("inf": an unbounded
interval). *ours* is `wbf_mission.addons.base.intervals`, which all tables use. *Student* of a ratio is
Fieller's interval.

The last table has eight simultaneous comparisons: the probability that all eight intervals cover the true
values, for single intervals and for joint ones.

    python benchmarks/interval_coverage.py --cases 2000
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from common import options_of, print_table
from numpy.typing import NDArray
from scipy import stats
from threadpoolctl import threadpool_limits

from wbf_mission.addons.base import intervals
from wbf_mission.addons.base.standings import scored
from wbf_mission.addons.boards.submission import read_pack

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator, tuple[int, int]], tuple[Floats, Floats]]

COUNTS = (5, 8, 12, 20, 40)
RESULTS = Path(__file__).parent.parent / "results" / "0.1.0"
COMPARED = 8


def made_up(spread: float, rare: float) -> tuple[Draw, float]:
    """Return a draw of synthetic paired losses, one with extra spread and rare misses, and the true ratio."""

    def draw(random: np.random.Generator, shape: tuple[int, int]) -> tuple[Floats, Floats]:
        hard = random.lognormal(0.0, 0.4, shape)
        misses = (random.random(shape) < rare) * random.exponential(3.0, shape)
        return hard * random.lognormal(-0.5, spread, shape) + misses, hard * random.lognormal(0.0, 0.3, shape)

    return draw, (np.exp(0.08 - 0.5 + spread**2 / 2.0) + 3.0 * rare) / np.exp(0.08 + 0.045)


def by_ones(
    values: Callable[[np.random.Generator, tuple[int, int]], Floats], mean: float
) -> tuple[Draw, float]:
    """Return a draw of pairs of `values` and ones, and the true mean."""
    return (lambda random, shape: (values(random, shape), np.ones(shape))), mean


def frozen(pack: str, estimator: str, above: str, below: str, field: str) -> tuple[Draw, float]:
    """Return a draw of paired losses, with replacement, from all scenarios of a pack, and the true ratio.

    `field` selects a field's loss at the end; an empty `field` selects the score over the run.
    """
    pairs = []
    for group in scored(read_pack(RESULTS / pack).rows):
        losses = group.final_losses[field] if field else -group.scores
        pairs.append(losses[[group.pairs.index((name, estimator)) for name in (above, below)]])
    one, other = np.concatenate(pairs, axis=1)

    def draw(random: np.random.Generator, shape: tuple[int, int]) -> tuple[Floats, Floats]:
        which = random.integers(0, len(one), shape)
        return one[which], other[which]

    return draw, float(one.mean() / other.mean())


def cases() -> dict[str, tuple[Draw, float]]:
    """Return the draw and the true ratio of each case by name."""
    return {
        "ratio, mild": made_up(0.4, 0.0),
        "ratio, skewed": made_up(1.0, 0.0),
        "ratio, 10 % rare misses": made_up(0.4, 0.1),
        "ratio, rows: greedy by spiral, TYLCV": frozen("own.zip", "epidemic", "greedy", "spiral", "tylcv"),
        "ratio, rows: six farms": frozen("farms.zip", "epidemic", "greedy", "adaptive-lawnmower", ""),
        "mean, normal": by_ones(lambda random, shape: random.normal(1.0, 1.0, shape), 1.0),
        "mean, exponential": by_ones(lambda random, shape: random.exponential(1.0, shape), 1.0),
        "mean, lognormal": by_ones(lambda random, shape: random.lognormal(0.0, 1.0, shape), np.exp(0.5)),
        "mean, 10 % rare outbreaks": by_ones(
            lambda random, shape: (
                random.exponential(0.1, shape) + (random.random(shape) < 0.1) * random.exponential(3.0, shape)
            ),
            0.4,
        ),
    }


def student(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the limits by Student's method, for ratios Fieller's; `a` and `b` are float64[cases, n]."""
    count = a.shape[1]
    most = stats.t.ppf(0.975, count - 1) * np.sqrt(count / (count - 1.0))
    found = [intervals._fieller(above, below, -most, most) for above, below in zip(a, b, strict=True)]
    return np.array([limits[0] for limits in found]), np.array([limits[1] for limits in found])


def ours(a: Floats, b: Floats, together: bool = False) -> tuple[Floats, Floats]:
    """Return the limits by our method, even for fewer environments than tables require."""
    found = intervals._intervals(list(zip(a, b, strict=True)), fewest=2, together=together)
    return np.array([one.low for one in found]), np.array([one.high for one in found])


def main() -> None:
    """Print the tables."""
    parser = options_of(__doc__)
    parser.add_argument("--cases", type=int, default=2000)
    many = parser.parse_args().cases
    methods = {"Student": student, "ours": ours}
    rows = []
    for case, (draw, true) in cases().items():
        texts: dict[str, dict[str, str]] = {name: {} for name in methods}
        for count in COUNTS:
            a, b = draw(np.random.default_rng(count), (many, count))
            for name, method in methods.items():
                low, high = method(a, b)
                held = 100.0 * np.mean((low <= true) & (true <= high))
                texts[name][f"n = {count}"] = f"{held:.0f} ({np.median(high - low) / abs(true):.2f})"
        rows += [{"case": case, "method": name, **texts[name]} for name in methods]
    print_table(rows)
    rows = []
    for case in ("ratio, mild", "ratio, skewed", "mean, normal", "mean, exponential"):
        draw, true = cases()[case]
        for name, together in (("each by itself", False), ("together", True)):
            row = {"case": case, "intervals": name}
            for count in COUNTS:
                random, held = np.random.default_rng(count), 0
                for _ in range(many // COMPARED):
                    low, high = ours(*draw(random, (COMPARED, count)), together=together)
                    held += bool(np.all((low <= true) & (true <= high)))
                row[f"n = {count}"] = f"{100.0 * held / (many // COMPARED):.0f}"
            rows.append(row)
    print_table(rows, f"{COMPARED} comparisons")


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
