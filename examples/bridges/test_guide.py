"""Runs the first session of docs/guides/vehicle.md, and compares the answers with the printed ones."""

import os
import re
import subprocess
from pathlib import Path

import pytest

GUIDE = Path(__file__).parents[2] / "docs/guides/vehicle.md"
PROGRAM = os.environ.get("PINGMAP")


def without_decimals(text):
    """Decimals and bytes may differ between machines."""
    text = re.sub(r'("team":|"bytes":|digest +)"?[0-9a-f…]+"?', r"\1", text)
    return re.sub(r"\.\d+", "", text).split()


@pytest.mark.skipif(not PROGRAM, reason="PINGMAP does not name the program")
def test_the_first_session_of_the_guide_runs_as_printed(tmp_path):
    text = GUIDE.read_text()
    settings, summary, session, answers = re.findall(r"```text\n(.*?)```", text, re.DOTALL)[:4]
    (tmp_path / "vehicle.toml").write_text(settings)
    (tmp_path / "session.jsonl").write_text(session)

    def run(line):
        command = line.replace("pingmap", f"'{PROGRAM}'", 1)
        return subprocess.run(command, shell=True, cwd=tmp_path, check=True, text=True, stdout=subprocess.PIPE).stdout

    # Indented lines and the two commands before the printed summary and answers, in their order.
    commands = re.findall(r"(?m)^    (pingmap .*)|^`(pingmap vehicle --config[^`]*)`", text)
    printed = {"--check": summary, "<": answers}
    for line in (one or other for one, other in commands):
        found = run(line)
        for sign, expected in printed.items():
            if sign in line:
                assert without_decimals(found) == without_decimals(expected)
    assert len(commands) == 7
