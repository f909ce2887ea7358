"""The paper's printed tables and how runs are laid beside them."""

import pytest

from jaxglider import paper
from tuning.reporting.flights import markdown_ranking, text_ranking
from tuning.reporting.tables import (
    CAVEAT,
    COMMAND_NOTE,
    UNSETTLED,
    decimals,
    figure,
    markdown_tables,
    outcome,
    text_table,
)

ROWS = ("transient", "average_tracking", "average_effort", "chattering")
CHANNELS = ("depth", "pitch", "heading")
PRINTED = {
    # scenario, channel, row: SMC, PPC, FxTPPC, as printed
    ("switching", "depth", "transient"): (0.3502, 0.2587, 0.2273),
    ("switching", "depth", "chattering"): (3.4095e-04, 0.0124, 1.3595e-05),
    ("switching", "pitch", "average_tracking"): (0.9783, 0.1060, 0.0449),
    ("switching", "pitch", "chattering"): (5.0657e-05, 0.0017, 3.9991e-06),
    ("switching", "heading", "transient"): (8.5853, 0.1818, 0.2732),
    ("switching", "heading", "average_effort"): (4.0989, 3.0909, 2.7979),
    ("waypoints", "depth", "average_tracking"): (0.1753, 0.3357, 0.1340),
    ("waypoints", "depth", "average_effort"): (0.1152, 0.2126, 0.0689),
    ("waypoints", "pitch", "transient"): (0.6817, 0.1143, 0.3776),
    ("waypoints", "pitch", "chattering"): (3.1798e-05, 0.0017, 8.1838e-06),
    ("waypoints", "heading", "average_tracking"): (5.9247, 0.2651, 0.1574),
    ("waypoints", "heading", "chattering"): (0.0566, 3.3337, 0.0322),
}


def _channel(base):
    names = (
        "max_error",
        "max_error_settled",
        "rms_error",
        "rms_effort",
        "chattering",
        "travel",
        "time_outside_funnel",
        "time_saturated",
    )
    return {name: base + 0.01 * n for n, name in enumerate(names)}


def _run(scenario="switching", plant="printed", controller="smc", base=0.5, **more):
    return {
        "scenario": scenario,
        "plant": plant,
        "controller": controller,
        "published_case": True,
        "end_time_s": 800.0,
        "finite": True,
        "capsized": False,
        "max_roll_rad": 0.75,
        "max_pitch_rad": 1.0,
        "waypoints_reached": None,
        "channels": {c: _channel(base + n) for n, c in enumerate(CHANNELS)},
        **more,
    }


def _cells(text, *starts):
    """The cells of the one Markdown row that begins with these."""
    found = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
    ]
    (row,) = [cells for cells in found if cells[: len(starts)] == list(starts)]
    return row[len(starts) :]


def test_the_printed_tables_are_24_rows_of_three():
    tables = paper.printed_tables()
    assert tables["columns"] == ["smc", "ppc", "fxtppc"]
    rows = [
        tables[scenario][channel][row]
        for scenario in ("switching", "waypoints")
        for channel in CHANNELS
        for row in ROWS
    ]
    assert len(rows) == 24
    assert all(len(row) == 3 and all(x > 0.0 for x in row) for row in rows)
    # A slip of the keyboard, one column or row copied to another place.
    assert len({tuple(row) for row in rows}) == 24
    assert set(tables) == {"columns", "switching", "waypoints"}


@pytest.mark.parametrize("place", PRINTED, ids=" ".join)
def test_spot_values_are_those_of_the_print(place):
    scenario, channel, row = place
    for controller, value in zip(("smc", "ppc", "fxtppc"), PRINTED[place], strict=True):
        assert paper.printed_value(scenario, channel, controller, row) == value


def test_sums_over_the_printed_tables_are_those_of_the_print():
    """One sum per table, typed from the print on its own, finds any slip at all."""

    def total(scenario):
        table = paper.printed_tables()[scenario]
        return sum(sum(table[c][row]) for c in CHANNELS for row in ROWS)

    first = (
        (0.3502 + 0.2587 + 0.2273 + 0.6239 + 0.1153 + 0.0579)
        + (8.5853 + 0.1818 + 0.2732 + 0.0995 + 0.1130 + 0.1203)
        + (0.9783 + 0.1060 + 0.0449 + 11.6699 + 0.1977 + 0.1966)
        + (0.1382 + 0.2319 + 0.0793 + 0.1371 + 0.0622 + 0.0597)
        + (4.0989 + 3.0909 + 2.7979 + 3.4095e-04 + 0.0124 + 1.3595e-05)
        + (5.0657e-05 + 0.0017 + 3.9991e-06 + 0.0592 + 3.3109 + 0.0256)
    )
    second = (
        (0.3266 + 0.3319 + 0.2990 + 0.6817 + 0.1143 + 0.3776)
        + (6.1737 + 0.2500 + 0.3006 + 0.1753 + 0.3357 + 0.1340)
        + (0.5086 + 0.2200 + 0.1516 + 5.9247 + 0.2651 + 0.1574)
        + (0.1152 + 0.2126 + 0.0689 + 0.1074 + 0.0837 + 0.0655)
        + (3.5468 + 3.2404 + 2.6476 + 2.0991e-04 + 0.0142 + 1.1378e-05)
        + (3.1798e-05 + 0.0017 + 8.1838e-06 + 0.0566 + 3.3337 + 0.0322)
    )
    assert total("switching") == pytest.approx(first, abs=1e-12)
    assert total("waypoints") == pytest.approx(second, abs=1e-12)


def test_the_doubts_named_beside_the_tables_are_true_of_them():
    table = paper.printed_tables()
    columns = range(3)
    below = sum(
        table[s][c]["transient"][n] < table[s][c]["average_tracking"][n]
        for s in paper.SCENARIOS
        for c in CHANNELS
        for n in columns
    )
    assert below == 6
    for scenario in paper.SCENARIOS:
        assert min(table[scenario]["heading"]["average_effort"]) > 1.5708
        assert table[scenario]["heading"]["transient"][0] > 3.1416


def test_what_the_paper_does_not_have_is_none():
    value = paper.printed_value
    assert value("my mission", "depth", "smc", "transient") is None
    assert value("switching", "depth", "fxtppc (gains)", "transient") is None


def test_markdown_lays_each_run_beside_its_printed_column():
    runs = [_run(base=0.5), _run(controller="fxtppc", base=0.7)]
    text = markdown_tables(runs)
    assert CAVEAT in text
    titles = ["smc paper", "smc here", "fxtppc paper", "fxtppc here"]
    assert _cells(text, "channel", "measure") == titles
    assert _cells(text, "depth [m]", "largest error") == [
        "0.3502",
        "0.5000",
        "0.2273",
        "0.7000",
    ]
    assert _cells(text, "heading [rad]", "rms error") == [
        "11.6699",
        "2.5200",
        "0.1966",
        "2.7200",
    ]
    assert _cells(text, "pitch [m]", "rms command step") == [
        "5.07e-05",
        "1.5400",
        "4.00e-06",
        "1.7400",
    ]
    assert _cells(text, "pitch [rad]", "largest error once settled") == [
        "-",
        "1.5100",
        "-",
        "1.7100",
    ]
    assert _cells(text, "pitch", "share of time saturated") == [
        "-",
        "1.5700",
        "-",
        "1.7700",
    ]


def test_each_case_has_a_table_of_its_own():
    text = markdown_tables(
        [_run(), _run("waypoints", controller="ppc"), _run(plant="rigid-body")]
    )
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## switching on printed",
        "## waypoints on printed",
        "## switching on rigid-body",
    ]
    assert "0.3319" in text


def test_zero_has_no_sign():
    assert [decimals(x, 1) for x in (-0.04, -0.0, -0.06)] == ["0.0", "0.0", "-0.1"]


def test_what_a_command_costs_has_the_unit_of_its_actuator():
    text = markdown_tables([_run(vehicle="SeaWing")])
    assert "## switching: SeaWing (printed)" in text
    for channel in ("depth [kg]", "pitch [m]", "heading [rad]"):
        for measure in ("rms command", "rms command step", "travel"):
            assert len(_cells(text, channel, measure)) == 2
    assert COMMAND_NOTE in text_table([_run()])


def test_tuned_gains_have_no_printed_column():
    text = markdown_tables([_run(), _run(controller="fxtppc (gains)")])
    titles = ["smc paper", "smc here", "fxtppc (gains) here"]
    assert _cells(text, "channel", "measure") == titles
    assert len(_cells(text, "depth [m]", "rms error")) == 3


def test_a_users_mission_is_not_compared_even_if_named_like_a_case():
    run = _run(controller="fxtppc", published_case=False)
    text = markdown_tables([run])
    assert CAVEAT not in text
    assert "0.2273" not in text
    assert _cells(text, "channel", "measure") == ["fxtppc here"]
    assert "paper" not in text_table([run])


def test_the_terminal_table_has_a_line_for_each_channel_and_run():
    text = text_table([_run(), _run(controller="ppc", base=0.6)])
    lines = [line.split() for line in text.splitlines()]
    assert lines[0] == ["switching", "on", "printed"]
    assert lines[1][-5:] == ["share", "of", "time", "rms", "error"]
    assert lines[2][-4:] == ["outside", "in", "the", "paper"]
    measures = [f"0.5{n}00" for n in range(7)]
    assert lines[3] == ["depth", "[m]", "smc", *measures, "0.0995"]
    assert lines[8][:3] == ["heading", "[rad]", "ppc"]
    assert lines[8][-1] == "0.1977"
    assert lines[9] == ["smc:", "800.0", "s,", "max", "roll", "0.75", "rad"]
    assert len({len(line) for line in text.splitlines()[2:9]}) == 1


def test_a_dash_in_the_column_of_settled_errors_is_explained():
    run = _run()
    assert UNSETTLED not in text_table([run])
    run["channels"]["depth"]["max_error_settled"] = None
    assert text_table([run]).endswith(UNSETTLED)
    assert UNSETTLED in markdown_tables([run])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({}, "800.0 s, max roll 0.75 rad"),
        (
            {"waypoints_reached": 4},
            "800.0 s, 4 waypoints reached, max roll 0.75 rad",
        ),
        (
            {"capsized": True, "max_roll_rad": 1.6},
            "800.0 s, max roll 1.60 rad, rolled past 90 deg",
        ),
        (
            {"capsized": True, "max_roll_rad": 6.3},
            "800.0 s, max roll 6.30 rad, ROLLED OVER",
        ),
        (
            {"finite": False, "capsized": True, "max_roll_rad": None},
            "800.0 s, max roll unknown, FAILED: not finite",
        ),
    ],
)
def test_the_end_of_a_run_is_told_in_words(more, words):
    assert outcome(_run(**more)) == words


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        (0.0, "0.0000"),
        (0.001, "0.0010"),
        (0.000999, "9.99e-04"),
        (-0.25, "-0.2500"),
        (9999.0, "9999.0000"),
        (10000.0, "1.00e+04"),
    ],
)
def test_small_and_large_numbers_keep_their_digits(value, text):
    assert figure(value) == text


def _flown(controller, energy, status="completed", **more):
    flight = {
        "energy_per_made_good_J_m": energy,
        "energy_per_through_water_J_m": 10.0,
        "made_good_m": 858.2,
        "heading_error_rad": 0.1,
        "pitch_error_rad": 0.01,
        "depth_rate_m_s": 0.1295,
        "energy_J": {"pump": 3224.0},
        "moves": {"mass_position": 12.0, "mass_angle": 48.0},
    }
    run = {"controller": controller, "flight": flight, "status": status}
    return {**_run(), **run, **more}


def test_flights_are_ranked_by_energy_for_the_way_and_lost_ones_stand_last():
    runs = [
        _flown("cheap-but-late", 5.0, "unfinished"),
        _flown("dear", 20.0),
        _flown("rolled", 9.0, capsized=True),
        _flown("none", None, finite=False),
        _flown("best", 11.01),
    ]
    order = ["best", "dear", "cheap-but-late", "rolled", "none"]
    lines = markdown_ranking(runs)
    rows = [line for line in lines if line.startswith("| ")][2:]
    assert [row.split(" | ")[0].strip("| ") for row in rows] == order
    cells = [cell.strip() for cell in rows[0].strip("|").split("|")]
    assert cells[1:] == [
        *("11.01", "10.00", "858", "5.7", "0.6", "0.130", "3224", "12", "48"),
        "completed",
    ]
    ends = [row.split("|")[-2].strip() for row in rows]
    assert ends == ["completed", "completed", "unfinished", "rolled over", "failed"]
    assert {cell.strip() for cell in rows[-1].split("|")[2:-2]} == {"-"}
    text = text_ranking(runs).splitlines()
    assert [line.split()[0] for line in text[2:]] == order


def test_yos_show_no_depth_error_even_of_a_law_that_was_lost_in_the_first_dive():
    text = text_table([_run(controller="slocum", halves=[{}]), _run(controller="smc")])
    assert "depth [m]" not in text
    assert "depth [m]" in text_table([_run(controller="smc")])


def test_a_glider_flung_far_away_does_not_widen_the_ranking():
    far = _flown("far", 1.0, capsized=True)
    far["flight"]["made_good_m"] = 7.4e37
    lines = text_ranking([_flown("near", 11.0), far]).splitlines()
    assert "7.4e+37" in lines[-1]
    assert len({len(line) for line in lines[1:]}) == 1


def test_one_flight_alone_has_no_ranking():
    assert text_ranking([_flown("slocum", 11.0), _run()]) == ""
    assert markdown_ranking([_flown("slocum", 11.0)]) == []


def test_flights_without_an_energy_model_are_ranked_by_their_heading():
    wild = _flown("wild", None)
    calm = _flown("calm", None)
    calm["flight"]["heading_error_rad"] = 0.05
    lines = text_ranking([wild, calm]).splitlines()
    assert "heading" in lines[0]
    assert [line.split()[0] for line in lines[2:]] == ["calm", "wild"]
