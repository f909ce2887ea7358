"""Whatever stands at a key of a file: read, or refused by name; never a traceback."""

import copy
import math
import re
import tomllib

import pytest
import tomli_w

from jaxglider import paper
from jaxglider.core.toml import ConfigError
from jaxglider.files import mission, uncertainty
from jaxglider.files.gains import decode_gains, encode_law
from jaxglider.vehicle.published import vehicle_of, vehicle_text
from tuning.problem.objective_file import read_objective

WRONG = {
    "text": "x",
    "no text": "",
    "truth": True,
    "nan": math.nan,
    "infinity": math.inf,
    "minus infinity": -math.inf,
    "huge": 10**400,
    "no number": [],
    "numbers": [1.0, 0.5],
    "texts": ["a"],
    "nested": [[1.0], [2.0, 3.0]],
    "table": {"zzz": 1.0},
    "tables": [{"zzz": 1.0}],
    "mixed": [1.0, "a", [], {}],
    "negative": -1.0,
    "nothing": 0.0,
    "empty table": {},
}
ALLOWED = ("numbers", "no number", "negative", "nothing", "empty table", "table")
"""May mean something; the others never do where a number stands."""
OBJECTIVE = """
[weights]
tracking = {depth = 1.0, pitch = 2.0, heading = 3.0}
effort = 0.1
chattering = 0.01
crowding = 60.0
roll = 10.0
roll_limit_rad = 0.5
saturation = 5.0
[aggregate]
kind = "cvar"
share = 0.2
"""


def template(text):
    """A template with what is commented out in it."""
    return tomllib.loads(
        re.sub(r"^# ((\[+[\w.]+\]+)|(\w+ = .*))", r"\1", text, flags=re.MULTILINE)
    )


def keys(tree, at=()):
    """Paths of everything in a tree of tables and lists of tables."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield (*at, key)
            yield from keys(value, (*at, key))
    elif isinstance(tree, list) and tree and isinstance(tree[0], dict):
        for number, value in enumerate(tree):
            yield from keys(value, (*at, number))


def put(tree, path, value):
    """A copy of the tree with another value at a path."""
    tree = copy.deepcopy(tree)
    table = tree
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    return tree


def read_vehicle(data):
    try:
        return vehicle_of(data, "mine.toml")
    except ValueError as error:
        raise ConfigError(str(error)) from error


@pytest.fixture(scope="module")
def scenario():
    return paper.make_scenario("switching", "seawing")


@pytest.fixture
def files(scenario, tmp_path):
    """A whole file of each kind as tables, how it is read, and values for each key."""
    schedule = template(mission.TEMPLATE())
    del schedule["controller"]["gains_file"]
    course = put(schedule, ("reference", "type"), "waypoints")
    del schedule["reference"]["waypoints"]
    model = paper.design_model(scenario.plant)

    def objective(data):
        path = tmp_path / "objective.toml"
        path.write_text(tomli_w.dumps(data), encoding="utf-8")
        return read_objective(path)

    def gains(data):
        return decode_gains(data, "waypoints", model)

    def laws(name):
        return encode_law(paper.make_loop("waypoints", "printed", name))

    drawn = tomllib.loads(uncertainty.TEMPLATE())
    vehicle = tomllib.loads(vehicle_text("seawing"))
    return {
        "mission": (schedule, mission.build_mission, 1),
        "course": (course, mission.build_mission, 1),
        "uncertainty": (
            drawn,
            lambda data: uncertainty.build_uncertainty(data, scenario),
            4,
        ),
        "smc": (laws("smc"), gains, 4),
        "fxtppc-roll": (laws("fxtppc-roll"), gains, 2),
        "vehicle": (vehicle, read_vehicle, 3),
        "objective": (tomllib.loads(OBJECTIVE), objective, len(WRONG)),
    }


@pytest.mark.parametrize(
    "kind",
    ["mission", "course", "uncertainty", "smc", "fxtppc-roll", "vehicle", "objective"],
)
def test_a_wrong_value_is_refused_by_the_name_of_its_key(files, kind):
    tree, read, values = files[kind]
    read(tree)
    told = ("unit", "symbol", "source", "doubt")
    paths = [path for path in keys(tree) if path[-1] not in told]
    names, tried = list(WRONG), set()
    for number, path in enumerate(paths):
        # Each key meets some of the values, and each value many a key.
        for turn in range(values):
            name = names[(number * values + turn) % len(names)]
            tried.add(name)
            message = ""
            try:
                read(put(tree, path, WRONG[name]))
            except ConfigError as error:
                message = str(error)
            is_text = path[-1] == "name" and isinstance(WRONG[name], str)
            right = name in ALLOWED or is_text
            assert _names(message, path) if message else right, (path, name, message)
    assert tried == set(names)


def _names(message, path):
    """Whether a message says where to look: the key, or the table that it is in."""
    steps = [step for step in path if isinstance(step, str) and step != "value"]
    key = re.sub(r"_(m|s|rad|deg|kg|N|N_m|m_s|1_m|1_s|deg_s)$", "", steps[-1])
    table = steps[-2] if len(steps) > 1 else key
    return key in message or table in message


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('[[vehicle]]\nnames = ["drag", "lift_slope"]\ncorrelation = [1.0, 0.5]', ()),
        ("[[vehicle]]\nnames = 'drag'\ncorrelation = [[1.0, 0.5]]", ("1 lists of 1",)),
        ("[[vehicle]]\nnames = ['drag', 'side_force_slope']\ncorrelation = [[1.0], []]",
         ("2 lists of 2", "[[1.0], []]")),
    ],
)  # fmt: skip
def test_a_correlation_that_is_no_matrix_is_refused(scenario, text, parts):
    law = 'law = "normal"\nstandard_deviation = 0.1\n'
    with pytest.raises(ConfigError) as refused:
        uncertainty.build_uncertainty(tomllib.loads(f"{text}\n{law}"), scenario)
    for part in ("vehicle[0].correlation must be one number or a list", *parts):
        assert part in str(refused.value)


@pytest.mark.parametrize(
    ("names", "parts"),
    [
        ("[]", ("must name at least 1 parameter",)),
        ('"dragg"', ("'dragg' is no parameter. Did you mean drag?",)),
        ("[1.0]", ("1.0 is no parameter",)),
    ],
)
def test_parameters_that_do_not_exist_are_refused_by_name(scenario, names, parts):
    text = f'[[vehicle]]\nnames = {names}\nlaw = "uniform"\nhalf_width = 0.1\n'
    with pytest.raises(ConfigError) as refused:
        uncertainty.build_uncertainty(tomllib.loads(text), scenario)
    for part in ("vehicle[0].names", *parts):
        assert part in str(refused.value)
