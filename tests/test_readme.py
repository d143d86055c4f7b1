"""The code of the README and of the pages of the folders runs as printed, and their links exist."""

import re
import types
from pathlib import Path
from typing import Any

import mujoco
import pytest

ROOT = Path(__file__).parents[1]
PAGES = {
    str(page.relative_to(ROOT)): page
    for folder in ("", "impactlaw/*", "impactlaw/*/*", "envs", "models", "scripts", "tests")
    for page in sorted(ROOT.glob(f"{folder}/README.md".lstrip("/")))
    if not page.parent.is_symlink()
}
BLOCKS = [
    pytest.param(block, id=f"{name}-{i}")
    for name, page in PAGES.items()
    for i, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL))
]


@pytest.mark.parametrize("block", BLOCKS)
def test_python_of_a_page_runs(block, tmp_path, monkeypatch, capsys):
    if "from dm_control" in block:
        pytest.importorskip("dm_control", reason="dm_control cannot be installed on Python 3.13")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block, "page", "exec"), names)
    printed = capsys.readouterr().out
    for line in re.findall(r"^print\(.*\)\s+# (\[.*|True.*)$", block, flags=re.MULTILINE):
        assert line in printed
    if hasattr(names.get("env"), "close"):
        names["env"].close()


def test_there_is_python_in_the_readme():
    assert len(BLOCKS) >= 7


THEIRS = """
import mujoco

class Env:
    def __init__(self):
        body = "<body><freejoint/><geom size='.1'/></body>"
        plane = "<geom type='plane' size='1 1 1' pos='0 0 -.5'/>"
        self.model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{plane}{body}</worldbody></mujoco>")
        self.data = mujoco.MjData(self.model)

    def step(self):
        mujoco.mj_step(m=self.model, d=self.data, nstep=5)
"""


def test_a_module_that_steps_by_itself_gets_a_law_as_the_page_says():
    page = PAGES["envs/README.md"].read_text()
    (block,) = (part for part in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL) if "def bounce" in part)
    names: dict[str, Any] = {}
    exec(block, names)
    theirs: Any = types.ModuleType("theirs")
    exec(THEIRS, theirs.__dict__)
    stepper_of = names["bounce"](theirs)
    for _ in range(2):  # the second environment has another model
        env, count, speed = theirs.Env(), 0, 0.0
        while env.data.time < 0.4:
            env.step()
            count, speed = count + len(stepper_of(env.model).events), max(speed, env.data.qvel[2])
        assert count == 1
        assert speed == pytest.approx(0.5 * (2 * 9.81 * 0.4) ** 0.5, rel=0.05)  # half of the speed of the fall
    assert theirs.mujoco.mj_step is not mujoco.mj_step


def anchors(page: Path) -> list[str]:
    """Return the names by which links reach the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL), flags=re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_somewhere(name):
    page = PAGES[name]
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)", page.read_text()):
        other = page.parent / target if target else page
        assert other.exists(), target
        assert not anchor or anchor in anchors(other), f"{target}#{anchor}"


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 200
