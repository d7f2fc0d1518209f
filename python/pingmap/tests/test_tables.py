"""Tables of any kind give the same result, and bad tables raise a clear exception."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pingmap


def frames(table: dict[str, Any], library: str) -> Any:
    """Returns the table as a frame of a library. Skips the test if the library is not installed."""
    return pytest.importorskip(library).DataFrame(table)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_frames_give_the_result_of_dictionaries(
    log: Path, model: Path, links: dict[str, list[float]], library: str
) -> None:
    table = dict(pingmap.read_log(log))
    expected = pingmap.predict(table, links, model=model)
    found = pingmap.predict(frames(table, library), frames(links, library), model=model)
    assert all(np.array_equal(found[name], expected[name]) for name in expected)


def test_pandas_accepts_results_and_missing_values(log: Path, model: Path, links: dict[str, list[float]]) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(pingmap.predict(log, links, model=model))
    assert len(frame) == 3 and frame["probability"].between(0, 1).all()
    log_frame = pandas.DataFrame(pingmap.read_log(log))
    log_frame["kind"] = pandas.Series(["fast"] + [None] * (len(log_frame) - 1))
    log_frame["tx_heading_deg"] = [90.0] + [np.nan] * (len(log_frame) - 1)
    assert len(pingmap.predict(log_frame, frame, model=model)["probability"]) == 3


def test_numbers_and_text_survive_the_border(log: Path, model: Path, links: dict[str, list[float]]) -> None:
    awkward = {**links, "Note": ['a "b", c', "", "ü"], "odd": [1e-300, 0.1 + 0.2, -0.0], "tx_id": ["007", "a", "b"]}
    found = pingmap.predict(log, awkward, model=model)
    assert found["Note"].tolist() == awkward["Note"] and found["tx_id"].tolist() == awkward["tx_id"]
    assert found["odd"].tobytes() == np.array(awkward["odd"]).tobytes()
    assert found["rx_easting_m"].tolist() == links["rx_easting_m"]


def test_columns_of_links_come_back_unchanged(log: Path, model: Path, links: dict[str, list[float]]) -> None:
    given: dict[str, Any] = {
        "#": [1, 2, 3],
        **links,
        "id": [2**53 + 1, 2, 3],
        "size": ["1_000", "inf", " 1 "],
        "Note": ["", "", ""],
        "is_new": [True, False, True],
        "Upper": [0.0, 0.0, 0.0],
    }
    with pytest.warns(pingmap.Warning, match="predictions replace the values of Upper"):
        found = pingmap.predict(log, given, model=model)
    assert list(found) == [*list(given)[:-1], "probability", "lower", "upper", "log_odds_mean", "log_odds_variance"]
    assert all(found[name].tolist() == values for name, values in given.items() if name != "Upper")
    eastings_m = np.array(links["tx_easting_m"])
    found = pingmap.predict(log, {**links, "tx_easting_m": eastings_m}, model=model)
    assert not np.shares_memory(found["tx_easting_m"], eastings_m)


def test_text_with_underscores_in_a_file_is_no_number(
    log: Path, model: Path, links: dict[str, list[float]], tmp_path: Path
) -> None:
    path, rows = tmp_path / "links.csv", zip(*links.values(), strict=True)
    path.write_text(f"{','.join(links)},size\n" + "".join(f"{','.join(map(repr, row))},1_000\n" for row in rows))
    assert pingmap.predict(log, path, model=model)["size"].tolist() == ["1_000"] * 3


def test_any_layout_and_type_of_numbers_is_accepted(log: Path) -> None:
    table = pingmap.read_log(log)
    other: dict[str, Any] = {name: np.repeat(values, 2)[::2] for name, values in table.items()}
    other["success"] = table["success"].astype(bool)
    other["tx_id"] = table["tx_id"].astype(object)
    assert pingmap.learn(other, additions="range").text == pingmap.learn(table, additions="range").text


def test_text_that_looks_like_a_remark_loses_no_rows(log: Path, model: Path, links: dict[str, list[float]]) -> None:
    found = pingmap.predict(log, {"tx_id": ["#1", "auv1", "#"], **links, "Note": ["a\rb", "#", "c\nd"]}, model=model)
    assert found["tx_id"].tolist() == ["#1", "auv1", "#"] and found["Note"].tolist() == ["a\rb", "#", "c\nd"]
    others = dict(pingmap.read_log(log))
    senders = others.pop("tx_id")
    renamed = {"tx_id": np.where(senders == "auv1", "#a", senders), **others}
    assert pingmap.learn(renamed, additions="range").report["events"] == len(senders)


def broken(log: Path, changes: dict[Any, Any]) -> dict[str, Any]:
    """Returns the log with other columns; those that are ``None`` are removed."""
    table = {**pingmap.read_log(log), **changes}
    return {name: values for name, values in table.items() if values is not None}


def test_bad_columns_are_refused_with_their_name(log: Path) -> None:
    table = pingmap.read_log(log)
    size = len(table["success"])
    nan = table["tx_easting_m"].copy()
    nan[4] = np.nan
    cases: dict[str, dict[Any, Any]] = {
        "rx_id": {"rx_id": None},
        "log.csv: line 6, column tx_easting_m: found \"nan\"": {"tx_easting_m": nan},
        "column time_s: found \"inf\"": {"time_s": np.full(size, np.inf)},
        "column tx_northing_m: found \"north\"": {"tx_northing_m": np.array(["north"] * size)},
        "column success: found": {"success": np.full(size, 2)},
        "one length, found": {"time_s": table["time_s"][:-1]},
        "expected an array of one dimension, found 2": {"time_s": np.zeros((size, 2))},
        "expected numbers or text, found": {"time_s": np.array([object()] * size)},
        "names of columns must be text": {3: table["time_s"]},
    }
    for words, changes in cases.items():
        with pytest.raises(ValueError) as caught:
            pingmap.learn(broken(log, changes))
        assert words in str(caught.value), str(caught.value)
        assert "/pingmap-" not in str(caught.value), "the message names the temporary folder"


def test_empty_logs_and_logs_of_one_outcome_are_refused(log: Path) -> None:
    table = pingmap.read_log(log)
    for bad, words in [
        ({}, "log.csv"),
        ({name: values[:0] for name, values in table.items()}, "no events"),
        (broken(log, {"success": np.ones(len(table["success"]), int)}), "--accept-bad-log"),
        ([], "LOG"),
        ("none.csv", "none.csv"),
        (Path("/"), "/"),
        ("a\0b", "a"),
        ("\udcff.csv", ".csv"),
        (17, "found int"),
        (None, "found NoneType"),
    ]:
        with pytest.raises(ValueError) as caught:
            pingmap.learn(bad)  # type: ignore[arg-type]
        assert words in str(caught.value), str(caught.value)


def test_unknown_and_bad_options_are_refused_with_the_words_of_the_command(log: Path) -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        ({"nonsense": 1}, "unexpected argument '--nonsense'"),
        ({"test_share": 2}, "--test-share"),
        ({"test_share": object()}, "test_share: expected a number, text or a path"),
        ({"json": True}, "--json"),
        ({"output": "model.toml"}, "--output"),
        ({"help": True}, 'expected no option help; see pingmap.run("learn", "--help")'),
    ]
    for options, words in cases:
        with pytest.raises(ValueError) as caught:
            pingmap.learn(log, **options)
        assert words in str(caught.value), str(caught.value)


def test_failures_that_are_not_bad_input_raise_the_error_of_the_package(log: Path, tmp_path: Path) -> None:
    missing = tmp_path / "none" / "model.toml"
    with pytest.raises(pingmap.Error, match="there is no folder"):
        pingmap.run("learn", str(log), "-o", str(missing))
    assert issubclass(pingmap.Error, RuntimeError)


def test_no_temporary_files_stay(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    pingmap.simulate(slots=10)
    with pytest.raises(ValueError):
        pingmap.learn({"time_s": [1.0]})
    assert list(tmp_path.iterdir()) == []


def test_dates_and_masked_values_are_refused(log: Path) -> None:
    table = dict(pingmap.read_log(log))
    dates = table | {"time_s": np.asarray(table["time_s"]).astype("datetime64[ns]")}
    with pytest.raises(ValueError, match="column time_s: expected numbers"):
        pingmap.learn(dates)
    masked = table | {"rx_easting_m": np.ma.masked_greater(table["rx_easting_m"], 0.0)}
    with pytest.raises(ValueError, match="column rx_easting_m: masked"):
        pingmap.learn(masked)


def test_a_column_success_that_holds_no_outcomes_keeps_its_numbers(
    log: Path, model: Path, links: dict[str, list[float]]
) -> None:
    success = [0.7, 1.0, float("nan")]
    count = len(links["tx_easting_m"])
    table = links | {"success": (success * count)[:count]}
    found = pingmap.predict(log, table, model=model)
    np.testing.assert_array_equal(found["success"], table["success"])
