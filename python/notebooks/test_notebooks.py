"""Every notebook runs from its first cell to its last one."""

import json
from pathlib import Path

import pytest

NOTEBOOKS = sorted(Path(__file__).parent.glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ["dgpc", "pingmap", "matplotlib", "sklearn"]:
        pytest.importorskip(module, reason=f"{module} is not installed: {path.name}")
    import matplotlib

    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "outputs are not committed"
            exec(compile("".join(cell["source"]), path.name, "exec"), names)
    assert list(tmp_path.glob("*.png")), "the notebook draws a picture"
    if isinstance(plan := names.get("plan"), dict):
        assert "--model=model.toml" in plan["command"], "the decision uses the model of the map"
