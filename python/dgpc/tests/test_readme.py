"""The programs in the README run, in order, and are those of the examples."""

import importlib.util
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1]
PROGRAMS = re.findall(r"```python\n(.*?)```", (PACKAGE / "README.md").read_text(), re.DOTALL)
HAS_SKLEARN = importlib.util.find_spec("sklearn") is not None


@pytest.mark.skipif(not HAS_SKLEARN, reason="scikit-learn is not installed: no programs of the README")
def test_the_programs_of_the_readme_run(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    for program in PROGRAMS:
        exec(compile(program, "README.md", "exec"), names)
    assert "two summaries at eight points: 0.4" in capsys.readouterr().out


def test_the_experiment_has_twenty_lines_and_is_that_of_the_figure() -> None:
    lines = [line for line in PROGRAMS[-1].splitlines() if line.strip()]
    assert len(lines) == 20
    assert PROGRAMS[-1] in (PACKAGE / "examples" / "two_agents.py").read_text()
