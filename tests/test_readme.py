"""What README shows runs as it stands there."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.splitlines()[-1][:30])
def test_python_of_the_readme_runs(block, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block, str(README), "exec"), names)
    printed = capsys.readouterr().out
    for line in re.findall(r"^print\(.*\)\s+# (\[.*|True.*)$", block, flags=re.MULTILINE):
        assert line in printed
    if hasattr(names.get("env"), "close"):
        names["env"].close()


def test_there_is_python_in_the_readme():
    assert len(BLOCKS) >= 2
