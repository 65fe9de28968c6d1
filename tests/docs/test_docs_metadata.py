"""What others read about the project by machine: how it is cited, and what package indexes sort it by."""

import json
import tomllib
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft7Validator
from trove_classifiers import classifiers, deprecated_classifiers

REPOSITORY = Path(__file__).parents[2]
SCHEMA = REPOSITORY / "tests" / "data" / "citation" / "schema-1.2.0.json"


@pytest.fixture
def citation():
    # The base loader keeps dates as texts, which is what the schema describes, but the year as well.
    told = yaml.load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"), yaml.BaseLoader)
    for one in told.get("references", []):
        one["year"] = int(one["year"])
    return told


@pytest.fixture
def project():
    return tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def faults(citation):
    validator = Draft7Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    return [f"{one.json_path}: {one.message}" for one in validator.iter_errors(citation)]


def test_the_citation_is_a_citation_file(citation, project):
    assert citation["cff-version"] == "1.2.0"
    assert faults(citation) == []
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]


def test_classifiers_are_known_to_package_indexes(project):
    assert [
        one for one in project["classifiers"] if one not in classifiers or one in deprecated_classifiers
    ] == []
