"""Field files and sets of fields: what is read, and what is refused in one line."""

from importlib.metadata import EntryPoint, EntryPoints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo import Crop
from sensors import field_files
from sensors.dynamics.epidemic import EpidemicParameters
from sensors.dynamics.soil import SoilParameters
from sensors.errors import FieldError
from sensors.field_files import field_from_table, field_names, field_to_table, load_field_set, read_fields
from sensors.fields import PAPER_FIELDS, Field, FieldSet

RUST = Field("rust", EpidemicParameters(0.2, 8), ("tomato",), 1.0, cost_above=5.0, title="rust of tomatoes")
PLAIN = {"name": "nitrogen", "kind": "continuous", "crops": ["tomato"], "default": 0.5}

names = st.from_regex(r"[a-z][a-z0-9_]{0,23}", fullmatch=True).filter(
    lambda name: name not in ("x", "y", "day", "time_s")
)
rates = st.floats(0, 1)
fields = st.builds(
    Field,
    name=names,
    dynamics=st.one_of(
        st.builds(EpidemicParameters, likelihood=rates, duration_days=st.integers(1, 126)),
        st.builds(SoilParameters, evaporation=rates, mean_rain=rates, square_humps=st.booleans()),
    ),
    crops=st.lists(st.sampled_from([*Crop, "sweet potato", "möhre"]), min_size=1, unique=True).map(tuple),
    default=rates,
    weight=st.floats(0, 1e6),
    cost_above=st.floats(0, 1e6),
    cost_below=st.floats(0, 1e6),
)


@given(fields)
def test_a_field_is_the_same_after_it_was_written_and_read(field):
    assert field_from_table(field_to_table(field), "here") == field


def test_the_benchmarks_fields_are_the_papers():
    assert load_field_set(["tylcv", "ccr", "soil"]) == PAPER_FIELDS
    assert [(f.weight, f.cost_above, f.cost_below, f.default) for f in PAPER_FIELDS] == [
        (1.0, 10.0, 1.0, 1.0),
        (0.2, 10.0, 1.0, 1.0),
        (0.1, 1.0, 1.0, 0.0),
    ]


def write(folder, text):
    (folder / "mine.toml").write_text(text)
    return "mine.toml"


def test_a_file_may_hold_several_fields_and_begins_at_its_folder(tmp_path):
    text = """
        [[field]]
        name = "nitrogen"
        kind = "continuous"
        crops = ["tomato"]
        default = 0.5
        [[field]]
        name = "rust"
        kind = "disease"
        crops = ["strawberry"]
        default = 1
        dynamics = { likelihood = 0.3, duration_days = 8 }
    """
    found = load_field_set(["soil", write(tmp_path, text)], tmp_path)
    assert found.names == ("soil", "nitrogen", "rust")
    assert found["nitrogen"].dynamics == SoilParameters()
    assert found["rust"].epidemic == EpidemicParameters(0.3, 8)
    assert (found["rust"].title, len(found["rust"].colours)) == ("rust", 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"no table \[\[field\]\]"),
        ("field = [3]", "field 1: is not a table"),
        ("colour = 1", "unknown key 'colour'"),
        ("name =", "not TOML"),
        ("a = " + "[" * 100_000, "nested too deeply|not TOML"),
        ("a = '" + "x" * 2**20 + "'", "larger than 1 MiB"),
    ],
)
def test_a_file_that_is_no_field_file_is_named(tmp_path, text, message):
    with pytest.raises(FieldError, match=rf"mine\.toml: .*({message})"):
        load_field_set([write(tmp_path, text)], tmp_path)


def test_files_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "latin.toml").write_bytes(b"name = '\xff'")
    for name, message in (("latin.toml", "not UTF-8"), ("no.toml", "no such"), (".toml", "no such")):
        with pytest.raises(FieldError, match=message):
            read_fields(tmp_path / name)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "../up"}, "a name is up to 24"),
        ({"name": "day"}, "a name is up to 24"),
        ({"name": 3}, "name: it is a whole number; give a text"),
        ({"kind": "animal"}, "unknown kind 'animal': choose disease, continuous, smooth, measured"),
        ({"kind": "disease"}, "likelihood is missing"),
        ({"crops": []}, "crops empty"),
        ({"crops": ["Maize!"]}, "crop .Maize!. is not a crop name; names of crops are up to 40"),
        ({"default": 2.0}, "default 2 is not in 0..1"),
        ({"weight": -1.0}, "weight -1.0"),
        ({"cost_above": float("inf")}, "cost_above inf"),
        ({"title": "two\nlines"}, "title"),
        ({"colours": ["red", "green"]}, "#rrggbb"),
        ({"color": "#000000"}, "color is unknown"),
        ({"dynamics": {"evaporation": 3.0}}, "evaporation 3.0 is not in 0..1"),
        ({"dynamics": {"likelihood": 0.5}}, "dynamics of a continuous field: unknown parameter 'likelihood'"),
    ],
)
def test_a_field_that_cannot_be_used_says_where_and_why(changes, message):
    with pytest.raises(FieldError, match=f"^mine.toml: .*{message}") as told:
        field_from_table({**PLAIN, **changes}, "mine.toml: field 1")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("missing", ["name", "crops", "default"])
def test_what_a_field_needs(missing):
    table = {key: value for key, value in PLAIN.items() if key != missing}
    with pytest.raises(FieldError, match=f"here: {missing} is missing"):
        field_from_table(table, "here")


def test_a_set_has_each_field_once_and_not_too_many():
    with pytest.raises(FieldError, match="'soil' is given twice"):
        load_field_set(["soil", "soil"])
    with pytest.raises(FieldError, match="0 fields"):
        FieldSet(())
    many = tuple(Field(f"f{k}", SoilParameters(), ("tomato",), 0.0) for k in range(17))
    with pytest.raises(FieldError, match="17 fields, expected 1 to 16"):
        FieldSet(many)
    with pytest.raises(FieldError, match="unknown field 'rust'"):
        PAPER_FIELDS.with_dynamics(rust=SoilParameters())


def register(monkeypatch, *points):
    points = EntryPoints(EntryPoint(*point, "wbf_mission.fields") for point in points)
    monkeypatch.setattr(field_files, "entry_points", lambda group: points.select(group=group))


def test_packages_register_fields(monkeypatch):
    here = "sensors.field_files:RUST"
    monkeypatch.setattr(field_files, "RUST", RUST, raising=False)
    register(monkeypatch, ("rust", here))
    assert load_field_set(["rust"])["rust"] == RUST
    assert field_names() == ("tylcv", "ccr", "soil", "rust")
    for points, message in (
        ([("rust", "sensors.no_such:RUST")], "cannot be loaded"),
        ([("rust", "sensors.field_files:field_names")], "not a sensors.fields.Field with this name"),
        ([("rust", here), ("rust", "another:RUST")], "registered twice"),
        ([], "unknown field 'rust': choose tylcv, ccr, soil"),
    ):
        register(monkeypatch, *points)
        with pytest.raises(FieldError, match=message):
            load_field_set(["rust"])
