"""Agents exchange frames, predict better than their prior, and survive a restart."""

from __future__ import annotations

import json
import re
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pingmap
from pingmap import Agent


@pytest.fixture
def events(log: Path) -> dict[str, dict[str, Any]]:
    """The events of each vehicle, by the name of their receiver."""
    table = pingmap.read_log(log)
    return {
        name: {column: values[table["rx_id"] == name] for column, values in table.items()}
        for name in np.unique(table["rx_id"]).tolist()
    }


def nll(agent: Agent, events: dict[str, Any], **options: Any) -> float:
    """Returns the mean negative log-likelihood of the events in nats."""
    links = {name: values for name, values in events.items() if name.endswith("_m")}
    p = agent.predict(links, **options)["probability"]
    return float(-np.log(np.where(events["success"] == 1, p, 1 - p)).mean())


def test_two_agents_exchange_frames_and_predict_better_than_the_prior(team: Path, events: dict[str, Any]) -> None:
    (first, own), (second, other) = list(events.items())[:2]
    sender, receiver = Agent(first, team), Agent(second, team)
    sender.record(own)
    receiver.record(other)
    sender.refit()
    end_s = float(own["time_s"].max())
    before = receiver.status()
    frames: list[bytes] = []
    while len(frames) < 20 and (frame := sender.next_frame(end_s)) is not None:
        assert len(frame) <= 32
        frames.append(frame)
    # A report is sent several times, because no peer acknowledges it.
    assert 1 <= len(set(frames)) < len(frames)
    for frame in sorted(set(frames), key=frames.index):
        assert receiver.receive(frame, end_s) == pingmap.Receipt(True, "")
    assert receiver.receive(frames[0], end_s) == pingmap.Receipt(False, "already received")
    receiver.refit()
    after = receiver.status()
    assert after["located_events"] + after["live_packets"] > before["located_events"] + before["live_packets"]
    assert after["accepted_frames"] == len(set(frames))
    assert after["members"][first]["ignored"] == {}
    prior = nll(Agent("stranger", team), own)
    assert nll(receiver, own) < prior
    assert nll(receiver, other, own_events_only=True) < nll(Agent("stranger", team), other)


def test_predictions_have_intervals_about_the_probability(team: Path, events: dict[str, Any], links: Any) -> None:
    name, own = next(iter(events.items()))
    agent = Agent(name, team)
    agent.record(own)
    found = agent.predict(links)
    assert list(found) == ["probability", "lower", "upper", "log_odds_mean", "log_odds_variance"]
    assert (found["lower"] <= found["probability"]).all() and (found["probability"] <= found["upper"]).all()
    assert "lower" not in agent.predict(links, own_events_only=True)


def test_an_agent_with_all_events_gives_the_numbers_of_the_command(
    team: Path, log: Path, model: Path, links: dict[str, Any]
) -> None:
    agent = Agent("survey", team, record_all_receivers=True)
    agent.record(log)
    agent.refit()
    # The command answers 0 to 1 far from all data, as at the third link.
    near = {name: values[:2] for name, values in links.items()}
    found = agent.predict(near)
    expected = pingmap.predict(log, near, model=model, time="typical")
    for name, values in found.items():
        assert np.allclose(values, expected[name], rtol=1e-6, atol=1e-9), name


def test_a_snapshot_restores_the_agent(team: Path, events: dict[str, Any], links: dict[str, Any]) -> None:
    name, own = next(iter(events.items()))
    agent = Agent(name, team)
    agent.record(own)
    agent.record_positions({"time_s": [1.0, 2.0], "easting_m": [0.0, 1.0], "northing_m": [5.0, 6.0]})
    agent.next_frame(float(own["time_s"].max()))
    snapshot = agent.snapshot()
    restored = Agent.restore(name, team, snapshot)
    assert restored.snapshot() == snapshot and restored.name == name
    assert restored.refit_due
    agent.refit()
    restored.refit()
    assert np.allclose(restored.predict(links)["probability"], agent.predict(links)["probability"], atol=1e-6)


def test_a_damaged_or_foreign_snapshot_is_refused(team: Path, events: dict[str, Any]) -> None:
    name, own = next(iter(events.items()))
    agent = Agent(name, team)
    agent.record(own)
    snapshot = agent.snapshot()
    damaged = bytearray(snapshot)
    damaged[len(damaged) // 2] ^= 1
    newer = snapshot[:8] + b"\xff\xff" + snapshot[10:]
    for bad in (bytes(damaged), newer, snapshot[:-1], snapshot[:5], b"", b"pickle"):
        with pytest.raises(ValueError, match="not a snapshot"):
            Agent.restore(name, team, bad)
    with pytest.raises(ValueError, match="it is of"):
        Agent.restore("other", team, snapshot)


def test_bad_input_is_refused_and_changes_nothing(
    team: Path, log: Path, events: dict[str, Any], tmp_path: Path
) -> None:
    (name, own), (_, other) = list(events.items())[:2]
    agent = Agent(name, team)
    for call in (
        lambda: agent.record(other),
        lambda: agent.record({**own, "success": np.full(len(own["success"]), 3)}),
        lambda: agent.record({}),
        lambda: agent.record_positions({"time_s": [1.0]}),
        lambda: agent.record_positions({"time_s": [np.nan], "easting_m": [0], "northing_m": [0]}),
        lambda: agent.record_positions({"time_s": [1.0, 2.0], "easting_m": [0], "northing_m": [0]}),
        lambda: agent.record_unused_slots([float("inf")]),
        lambda: agent.predict({"tx_easting_m": [0]}),
        lambda: agent.next_frame(0.0, 3),
        lambda: agent.set_muted("nobody"),
        lambda: Agent("stranger", team).next_frame(),
        lambda: Agent(name, tmp_path / "none.toml"),
        lambda: Agent(name, log),
        lambda: Agent(name, tmp_path),
    ):
        with pytest.raises(ValueError) as caught:
            call()
        assert str(caught.value)
    assert agent.status()["own_events"] == 0
    # A time that is not finite counts as unknown.
    assert agent.next_frame(np.nan) is None and agent.next_frame(-np.inf, 10**6) is None
    for frame in (b"", b"\0" * 32, bytes(range(40))):
        receipt = agent.receive(frame, np.nan)
        assert not receipt.accepted and receipt.reason


def test_bad_files_and_lengths_raise_value_errors_that_name_them(team: Path, tmp_path: Path) -> None:
    agent, bad, latin = Agent("auv1", team), tmp_path / "bad.csv", tmp_path / "latin.csv"
    bad.write_text("time_s,easting_m,northing_m\n1,0,0\n2,x,0\n")
    latin.write_bytes(b"tx_id\n\xff\n")
    reads: list[Any] = [agent.record, agent.predict, agent.record_positions]
    for path, words in [
        (tmp_path / "none.csv", "cannot be read: No such file"),
        (tmp_path, "cannot be read: Is a directory"),
        (latin, "cannot be read: 'utf-8'"),
        (bad, ""),
    ]:
        for read in reads if path == bad else [*reads, pingmap.Model.read]:
            for given in (path, str(path)):
                with pytest.raises(ValueError, match=re.escape(f"{path}: {words}")):
                    read(given)
    for table in ({"time_s": [1.0]}, {"time_s": ["x"], "easting_m": [0], "northing_m": [0]}):
        with pytest.raises(ValueError, match="^positions: "):
            agent.record_positions(table)
    assert agent.next_frame(0.0, 2**70) is None
    for frame_bytes in (-1, 3):
        with pytest.raises(ValueError, match=f"frame_bytes must be at least 32, found {frame_bytes}"):
            agent.next_frame(0.0, frame_bytes)


def test_a_muted_member_has_no_effect(team: Path, events: dict[str, Any]) -> None:
    (first, own), (second, _) = list(events.items())[:2]
    sender, receiver = Agent(first, team), Agent(second, team)
    sender.record(own)
    sender.refit()
    frame = sender.next_frame(float(own["time_s"].max()))
    assert frame is not None
    receiver.set_muted(first)
    receiver.receive(frame)
    assert "muted" in receiver.status()["members"][first]["ignored"]
    assert receiver.status()["located_events"] == 0


def test_an_agent_learns_its_own_model(team: Path, events: dict[str, Any]) -> None:
    name, own = next(iter(events.items()))
    agent = Agent(name, team)
    agent.record(own)
    agent.adapt()
    assert nll(agent, own) < nll(Agent(name, team), own)
    json.dumps(agent.status())


def test_threads_share_an_agent(team: Path, events: dict[str, Any], links: dict[str, Any]) -> None:
    name, own = next(iter(events.items()))
    agent = Agent(name, team)
    agent.record(own)
    found: list[Any] = []
    threads = [threading.Thread(target=lambda: found.append(agent.predict(links)["probability"])) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8 and all(np.array_equal(one, found[0]) for one in found)
