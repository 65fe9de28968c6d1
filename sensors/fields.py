"""Fields: the quantities sensed on a farm, their dynamics, and the costs of estimation errors.

Arrays, columns and readings have the order of a `FieldSet`. `PAPER_FIELDS` are the three fields of the
benchmark; `sensors.field_files` reads other fields from files.

All values are in 0..1. A disease has the value 1 for a healthy, 0.5 for an infected and 0 for a lost plant. A
continuous field is scaled to 0..1; `Field.range` gives its minimum and maximum in the field's unit.

>>> PAPER_FIELDS.names, PAPER_FIELDS["ccr"].kind, PAPER_FIELDS["soil"].kind
(('tylcv', 'ccr', 'soil'), 'disease', 'continuous')
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from geo.grid import CROP_NAMES, NOT_GROWN, is_crop_name
from geo.texts import unknown
from sensors.dynamics.continuous import ContinuousDynamics, Measured
from sensors.dynamics.epidemic import CCR, TYLCV, EpidemicParameters
from sensors.dynamics.soil import SoilParameters
from sensors.errors import FieldError
from sensors.lazy_fields import LARGE_FROM_CELLS, LazyFields

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geo.grid import FarmGrid

Kind = Literal["disease", "continuous"]
Dynamics = EpidemicParameters | ContinuousDynamics

ALL_CROPS = "all"
"""In `Field.crops`, this stands for all crops of a farm."""
MAX_FIELDS = 16
"""Largest number of fields, so that a cell's readings of all fields fit into one MAVLink message."""
HEALTH_COLOURS = ("#5a0f14", "#f08a24", "#4f9d5d")
"""Colours of lost, infected and healthy plants."""
WATER_COLOURS = (
    *("#ffffd9", "#edf8b1", "#c7e9b4", "#7fcdbb", "#41b6c4"),
    *("#1d91c0", "#225ea8", "#253494", "#081d58"),
)
"""Colours from dry to wet (YlGnBu of ColorBrewer)."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,23}")
_RESERVED = ("x", "y", "day", "time_s")
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
_MAX_TEXT = 60


@dataclass(frozen=True, slots=True)
class Field:
    """A sensed quantity.

    Parameters
    ----------
    name : str
        Name, also of columns, arrays and random streams: up to 24 lower-case letters, digits and underscores.
    dynamics : EpidemicParameters or ContinuousDynamics
        The dynamics; the class of the dynamics decides the kind of the field. `Measured` is for fields that
        are not simulated.
    crops : tuple of str
        Crops that have this field: names of the benchmark's crops (`geo.Crop`) or of a farm's crops, or
        `ALL_CROPS`. A disease infects these crops on any owner's land. Errors are scored in the owner's cells
        with these crops.
    default : float
        Value (0..1) assumed for cells without observations.
    weight : float
        Weight of the field's errors in the score, >= 0.
    cost_above, cost_below : float
        Factors of the squared error of an estimate above the truth and of an estimate below it, >= 0.
    title : str
        Name in pictures and tables; if empty, `name` is used.
    unit : str
        Unit of the values, for pictures.
    colours : tuple of str
        Two or more colours ``#rrggbb`` for values from 0 to 1; if empty, those usual for the kind.
    range : tuple of float
        Values in `unit` that are stored as 0 and as 1, the lower first; for a disease always (0, 1).

    Raises
    ------
    FieldError
        If a value cannot be used.

    Examples
    --------
    >>> acidity = Field("ph", Measured(), (ALL_CROPS,), default=0.5, unit="pH", range=(4.0, 9.0))
    >>> acidity.to_unit(acidity.default), acidity.from_unit(np.array([4.0, 5.0, 20.0])).tolist()
    (6.5, [0.0, 0.2, 1.0])
    """

    name: str
    dynamics: Dynamics
    crops: tuple[str, ...]
    default: float
    weight: float = 1.0
    cost_above: float = 1.0
    cost_below: float = 1.0
    title: str = ""
    unit: str = ""
    colours: tuple[str, ...] = ()
    range: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or self.name in _RESERVED:
            raise FieldError(
                f"field {self.name!r:.60}: a name is up to 24 lower-case letters, digits and underscores,"
                f" begins with a letter and is not one of {', '.join(_RESERVED)}"
            )
        if not isinstance(self.dynamics, EpidemicParameters | ContinuousDynamics):
            found = type(self.dynamics).__name__
            raise self._error(f"dynamics is {found}, expected EpidemicParameters or ContinuousDynamics")
        strange = [crop for crop in self.crops if not is_crop_name(crop)]
        if strange:
            raise self._error(f"crop {strange[0]!r:.60} is not a crop name; {CROP_NAMES}")
        if not self.crops or len(set(self.crops)) < len(self.crops):
            raise self._error(f"crops {', '.join(self.crops) or 'empty'}; give one or more crops, each once")
        if not 0.0 <= self.default <= 1.0:
            raise self._error(f"default {self.default} is not in 0..1")
        for name in ("weight", "cost_above", "cost_below"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise self._error(f"{name} {getattr(self, name)} is negative or not finite")
        for name in ("title", "unit"):
            text = getattr(self, name)
            if len(text) > _MAX_TEXT or not text.isprintable():
                raise self._error(f"{name} {text!r:.70} is not one line of up to {_MAX_TEXT} characters")
        if len(self.colours) == 1 or not all(_COLOUR.fullmatch(colour) for colour in self.colours):
            raise self._error(f"colours {self.colours!r:.70} are not two or more of the form #rrggbb")
        low, high = self.range
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise self._error(f"range {low:g}, {high:g}: give two finite numbers, the lower first")
        if self.kind == "disease" and self.range != (0.0, 1.0):
            raise self._error("a disease has the values 1 (healthy), 0.5 and 0 (lost); leave out its range")
        if not self.title:
            object.__setattr__(self, "title", self.name)
        if not self.colours:
            disease = self.kind == "disease"
            object.__setattr__(self, "colours", HEALTH_COLOURS if disease else WATER_COLOURS)

    def _error(self, text: str) -> FieldError:
        return FieldError(f"field {self.name}: {text}")

    @property
    def kind(self) -> Kind:
        """Kind of the field, either a disease (with three values) or a continuous field."""
        return "disease" if isinstance(self.dynamics, EpidemicParameters) else "continuous"

    @property
    def epidemic(self) -> EpidemicParameters:
        """The epidemic parameters of a disease; a continuous field raises FieldError."""
        if not isinstance(self.dynamics, EpidemicParameters):
            raise self._error("is not a disease")
        return self.dynamics

    @property
    def continuous(self) -> ContinuousDynamics:
        """The dynamics of a continuous field; a disease raises FieldError."""
        if not isinstance(self.dynamics, ContinuousDynamics):
            raise self._error("is a disease, not a continuous field")
        return self.dynamics

    @property
    def is_simulated(self) -> bool:
        """Whether the field can be simulated; otherwise it can only be measured."""
        return not isinstance(self.dynamics, Measured)

    def to_unit(self, values: Any) -> Any:
        """Convert values in 0..1 (scalar or array) to the field's unit."""
        low, high = self.range
        return low + values * (high - low)

    def from_unit(self, values: Any) -> Any:
        """Convert values in the field's unit (scalar or array) to 0..1, with clipping; NaN stays NaN."""
        low, high = self.range
        return np.clip((np.asarray(values, np.float64) - low) / (high - low), 0.0, 1.0)

    def crops_on(self, grid: FarmGrid) -> Sequence[str]:
        """Return the field's crops by name, on the farm of a grid."""
        every = ALL_CROPS in self.crops
        return [crop for crop in grid.crops if crop not in NOT_GROWN] if every else self.crops

    def hosts(self, grid: FarmGrid, where: Any = ...) -> NDArray[np.bool_]:
        """Return a new mask of all owners' cells with the field's crops: bool[W, H], or its part `where`."""
        return grid.of_crops(self.crops_on(grid), where)

    def mask(self, grid: FarmGrid, where: Any = ...) -> NDArray[np.bool_]:
        """Return a new mask of the owner's cells with the field's crops: bool[W, H], or its part `where`."""
        cells = self.hosts(grid, where)
        cells &= grid.owned[where]
        return cells


@dataclass(frozen=True, slots=True, repr=False)
class FieldSet:
    """Between 1 and `MAX_FIELDS` fields with different names, in the order that all arrays have.

    Raises
    ------
    FieldError
        If there are no fields or too many, or two have the same name.

    Examples
    --------
    >>> two = FieldSet((PAPER_FIELDS["soil"], PAPER_FIELDS["tylcv"]))
    >>> two, two.index("tylcv"), two.defaults, [field.name for field in two.diseases]
    (FieldSet(soil, tylcv), 1, (0.0, 1.0), ['tylcv'])
    """

    fields: tuple[Field, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.fields) <= MAX_FIELDS:
            raise FieldError(f"fields: {len(self.fields)} fields, expected 1 to {MAX_FIELDS}")
        twice = [name for name in self.names if self.names.count(name) > 1]
        if twice:
            raise FieldError(f"fields: {twice[0]!r} is given twice; every field needs a different name")

    def __repr__(self) -> str:
        return f"FieldSet({', '.join(self.names)})"

    def __len__(self) -> int:
        return len(self.fields)

    def __iter__(self) -> Iterator[Field]:
        return iter(self.fields)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, key: str | int) -> Field:
        """Return a field by name or index."""
        return self.fields[self.index(key) if isinstance(key, str) else key]

    def index(self, name: str) -> int:
        """Return the index of a field; raise FieldError if no field has this name."""
        if name not in self.names:
            raise FieldError(unknown("field", name, self.names))
        return self.names.index(name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields, in the order of the fields."""
        return tuple(field.name for field in self.fields)

    @property
    def crops(self) -> tuple[str, ...]:
        """Crops that have any of the fields, each once; empty if a field has `ALL_CROPS`."""
        named = tuple(dict.fromkeys(crop for field in self.fields for crop in field.crops))
        return () if ALL_CROPS in named else named

    @property
    def defaults(self) -> tuple[float, ...]:
        """Values that are assumed for cells without observations, one for each field."""
        return tuple(field.default for field in self.fields)

    @property
    def diseases(self) -> tuple[Field, ...]:
        """The fields that are diseases."""
        return tuple(field for field in self.fields if field.kind == "disease")

    @property
    def continuous(self) -> tuple[Field, ...]:
        """The continuous fields."""
        return tuple(field for field in self.fields if field.kind == "continuous")

    def require_simulated(self) -> None:
        """Raise FieldError if a field is only measured, as a simulated camera cannot read such a field."""
        measured = ", ".join(field.name for field in self.fields if not field.is_simulated)
        if measured:
            raise FieldError(
                f"fields: {measured} can only be measured, and a simulated camera needs dynamics; "
                'give a kind such as "continuous" and a table [field.dynamics] (docs/fields.md)'
            )

    def scored(self, grid: FarmGrid) -> NDArray[np.bool_]:
        """Return the masks of the scored cells; on a large farm as a `LazyFields`, which takes no memory."""
        if grid.crop.size < LARGE_FROM_CELLS:
            return self.masks(grid)

        def read(k: int, columns: slice) -> NDArray[np.bool_]:
            return self.fields[k].hosts(grid, columns) & grid.owned[columns]

        return cast("NDArray[np.bool_]", LazyFields((len(self.fields), *grid.shape), read, np.bool_))

    def masks(self, grid: FarmGrid) -> NDArray[np.bool_]:
        """Return for each field the mask of the owner's cells in which the field is scored, bool[n, W, H]."""
        masks = np.empty((len(self.fields), *grid.shape), np.bool_)
        for field, mask in zip(self.fields, masks, strict=True):
            mask[...] = field.mask(grid)
        return masks

    def with_dynamics(self, **dynamics: Dynamics) -> FieldSet:
        """Return the same fields with new dynamics for some fields, given as ``name=dynamics``.

        Examples
        --------
        >>> fields = PAPER_FIELDS.with_dynamics(ccr=EpidemicParameters(likelihood=0.3, duration_days=10))
        >>> fields["ccr"].epidemic.likelihood, fields["tylcv"] == PAPER_FIELDS["tylcv"]
        (0.3, True)
        """
        for name in dynamics:
            self.index(name)
        return FieldSet(
            tuple(replace(field, dynamics=dynamics.get(field.name, field.dynamics)) for field in self.fields)
        )


PAPER_FIELDS = FieldSet(
    (
        Field("tylcv", TYLCV, ("tomato",), 1.0, cost_above=10.0, title="TYLCV (tomato)", unit="health"),
        Field(
            *("ccr", CCR, ("strawberry",), 1.0),
            weight=0.2,
            cost_above=10.0,
            title="charcoal rot (strawberry)",
            unit="health",
        ),
        Field(
            *("soil", SoilParameters(), ("strawberry", "tomato"), 0.0),
            weight=0.1,
            title="soil humidity",
            unit="part of saturation",
        ),
    )
)
"""The benchmark's fields: tomato yellow leaf curl virus, charcoal rot of strawberries, soil humidity."""
