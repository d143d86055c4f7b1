"""The command line: one clear line and exit code 2 for wrong input, and no incomplete output."""

import importlib.util
import signal
import subprocess
import sys
import time

import pytest

import impactlaw
from impactlaw.cli import Compare, Inspect, Laws, Scenes, main
from impactlaw.laws import LAWS
from impactlaw.models import SCENES

SHORT = ("--duration", "0.02")


@pytest.fixture
def run(command):
    return command


def test_the_installed_command_runs(tmp_path):
    command = [sys.executable, "-m", "impactlaw.cli", "compare", "wedge", "--restitution", "2"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stderr) == (2, "impactlaw: restitution must lie in [0, 1], got 2.0\n")


def test_the_version_is_that_of_the_package(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["impactlaw", "--version"])
    main()
    assert capsys.readouterr().out == f"impactlaw {impactlaw.__version__}\n"


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("compare", "newtons_cradle"), "a comparison"),
        (("identify", "run.rrd"), "a fit"),
        (("study", "--quick"), "a study"),
    ],
)
def test_without_matplotlib_commands_that_draw_say_so_before_they_begin(words, what, run, tmp_path, monkeypatch):
    find = importlib.util.find_spec
    hidden = {"matplotlib": None}
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *of: hidden.get(name, find(name, *of)))
    told = f"impactlaw: the picture of {what} needs matplotlib, which is not installed: pip install matplotlib\n"
    assert run(*words) == (2, "", told)
    assert not list(tmp_path.iterdir())


def test_output_that_nobody_reads_to_its_end_is_no_error():
    command = [sys.executable, "-m", "impactlaw.cli", "plan", "newtons_cradle"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 1


def test_a_command_without_standard_output_runs():
    command = f"{sys.executable} -m impactlaw.cli laws >&-"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_output_that_cannot_be_written_is_one_line():
    command = f"{sys.executable} -m impactlaw.cli laws > /dev/full"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stderr) == (1, "impactlaw: cannot write the output: No space left on device\n")


def heed_interrupts():
    """Handle SIGINT, which is ignored if a shell has started the tests in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def comparing(folder):
    """Start a long comparison into a folder, and return its process once it has begun to write."""
    command = [sys.executable, "-m", "impactlaw.cli", "compare", "newtons_cradle", "--duration", "1e4", "--out", "out"]
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
    while not list(folder.glob("out/.unfinished-*/*.rrd")):
        assert process.poll() is None
        time.sleep(0.05)
    return process


@pytest.mark.parametrize(
    ("number", "line", "code"), [(signal.SIGINT, "interrupted", 130), (signal.SIGTERM, "terminated", 143)]
)
def test_an_interrupted_command_is_one_line_and_leaves_nothing_behind(number, line, code, tmp_path):
    with comparing(tmp_path) as process:
        process.send_signal(number)
        if number == signal.SIGTERM:  # as `timeout` does
            process.send_signal(number)
        told = process.communicate(timeout=600)[1].splitlines()
    assert [text for text in told if "re_sdk" not in text] == [f"impactlaw: {line}"]  # rerun may report what it drops
    assert process.returncode == code
    assert not list(tmp_path.iterdir())


def test_what_a_killed_command_leaves_is_removed_by_the_next_one(run, tmp_path):
    with comparing(tmp_path) as process:
        assert len(list(tmp_path.glob("out/.unfinished-*"))) == 1
        assert run("compare", "wedge", *SHORT, "--out", str(tmp_path / "out"))[0] == 0
        assert len(list(tmp_path.glob("out/.unfinished-*"))) == 1  # the first command is still running
        process.kill()
    assert run("compare", "wedge", *SHORT, "--out", str(tmp_path / "out"))[0] == 0
    assert not list(tmp_path.glob("out/.unfinished-*"))


HALVES = """
from dataclasses import dataclass
from impactlaw.laws import Law, Target
@dataclass(frozen=True)
class Halves(Law):
    e: float
    def target(self, collision):
        return Target(-self.e * collision.pre_contact_velocity)
"""


def test_a_law_of_ones_own_is_compared_by_its_file(tmp_path):
    (tmp_path / "halves.py").write_text(HALVES)
    (tmp_path / "own.json").write_text('{"law class": "halves:Halves", "e": 0.25}')
    command = [sys.executable, "-c", "import sys; sys.path.remove(''); from impactlaw.cli import main; main()"]
    command += ["compare", "wedge", "--laws", "./own.json", "moreau", *SHORT]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert "laws: own = Halves(e=0.25), moreau = Moreau(restitution=1.0)" in done.stdout
    assert (tmp_path / "out" / "wedge" / "own.rrd").exists()


def test_files_of_laws_that_would_be_runs_of_one_name_are_refused(run, tmp_path):
    for name in ("mujoco", "moreau", "own"):
        (tmp_path / f"{name}.json").write_text('{"law class": "impactlaw.laws.moreau:Moreau", "restitution": 0.25}')
    for laws, name in ((["mujoco.json"], "mujoco"), (["moreau", "moreau.json"], "moreau")):
        assert run("compare", "--laws", *laws) == (
            2,
            "",
            f"impactlaw: laws has {name!r} twice: runs are named by their laws\n",
        )
    told = "impactlaw: of the laws 'own' none takes a restitution, got 0.5; leave it out\n"
    assert run("compare", "--laws", "own.json", "--restitution", "0.5") == (2, "", told)


def test_compare_writes_into_out_and_prints_the_table(run, tmp_path):
    code, out, err = run("compare", *SHORT)
    assert code == 0, err
    assert "(0, 0, 0, 0, 1)" in out
    written = {path.name for path in (tmp_path / "out" / "newtons_cradle").iterdir()}
    assert {"table.csv", "picture.png", "reversal.rrd", "mujoco.rrd"} <= written
    assert not any(name.startswith(".") for name in written)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("compare", "nosuch"), "unknown scene"),
        (("compare", "nosuch.xml"), "nosuch.xml"),
        (("compare", "."), "directory"),
        (("compare", "notes.xml"), "notes.xml"),
        (("compare", "page.xml"), "page.xml"),
        (("compare", "sticky.xml"), "adhesion"),
        (("compare", "deep.xml"), "overlap"),
        (("compare", "--restitution", "-0.5"), "restitution"),
        (("compare", "--restitution", "1.5"), "restitution"),
        (("compare", "--restitution", "nan"), "restitution"),
        (("compare", "--laws", "moro"), "'moreau'"),
        (("compare", "--laws", "moreau", "newton", "moreau"), "'moreau' twice"),
        (("compare", "--timestep", "0"), "timestep"),
        (("compare", "--duration", "0.0001"), "duration must be a timestep, 0.005 s, or more, got 0.0001 s"),
        (("compare", "--timestep", "5"), "duration must be a timestep, 5 s, or more, got 4 s"),
        (("compare", "--out", "notes.xml/sub"), "cannot write"),
        (("plan", "wedge", "--contact-model", "soft", "--scheme", "time-stepping"), "scheme means nothing"),
        (("inspect", "nosuch.rrd"), "nosuch.rrd"),
        (("inspect", "notes.xml"), "notes.xml"),
        (("inspect", f"{300 * 'a'}.rrd"), "cannot reach aaa"),
        (("identify", f"{300 * 'a'}.csv"), "aaa.csv: File name too long"),
        (("plan", f"{300 * 'a'}.xml"), "aaa.xml: File name too long"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(arguments, message, tmp_path, run):
    (tmp_path / "notes.xml").write_text("these are notes")
    (tmp_path / "page.xml").write_text("<html><body/></html>")
    body = '<body pos="0 0 {height}"><freejoint/><geom name="ball" size=".1" condim="1" adhesion="{adhesion}"/></body>'
    plane = '<geom name="floor" type="plane" size="1 1 1" condim="1"/>'
    for name, height, adhesion in (("sticky", 1, 1), ("deep", 0.05, 0)):
        scene = f"<mujoco><worldbody>{plane}{body.format(height=height, adhesion=adhesion)}</worldbody></mujoco>"
        (tmp_path / f"{name}.xml").write_text(scene)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    code, _, err = run(*arguments)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1, err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_inspect_prints_the_collisions_and_writes_them_as_csv(run, tmp_path):
    assert run("compare", "ball_chain", *SHORT)[0] == 0
    code, out, err = run("inspect", "out/ball_chain/moreau.rrd", "--csv", "collisions.csv")
    assert code == 0, err
    assert "ball1/ball2" in out
    assert "ball1/ball2" in (tmp_path / "collisions.csv").read_text()
    code, _, err = run("inspect", "out/ball_chain/moreau.rrd", "--csv", "missing/collisions.csv")
    assert code == 2
    assert "cannot write missing/collisions.csv: " in err
    assert "None" not in err


@pytest.mark.parametrize(
    ("csv", "message"),
    [
        ("run.rrd", "ends with .rrd"),
        ("other.RRD", "ends with .rrd"),
        ("linked.csv", "is the recording that is read"),
        ("folder/../plain", "is the recording that is read"),
    ],
)
def test_inspect_writes_no_table_over_a_recording(csv, message, run, tmp_path, cradle_log):
    content = cradle_log[0].read_bytes()
    for name in ("run.rrd", "plain"):
        (tmp_path / name).write_bytes(content)
    (tmp_path / "linked.csv").symlink_to("run.rrd")
    (tmp_path / "folder").mkdir()
    code, out, err = run("inspect", "plain" if csv.endswith("plain") else "run.rrd", "--csv", csv)
    assert (code, out) == (2, "")
    assert message in err
    assert len(err.splitlines()) == 1, err
    assert {(tmp_path / name).read_bytes() for name in ("run.rrd", "plain")} == {content}
    assert not (tmp_path / "other.RRD").exists()


def test_laws_and_scenes_are_listed_one_line_each(capsys):
    Laws()()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(LAWS)
    assert all(len(line.split()) > 3 for line in lines)
    Scenes()()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(SCENES)
    assert all(len(line.split()) > 3 for line in lines)


def test_commands_are_values():
    assert Compare(scene="wedge").scene == "wedge"
    assert Inspect(file="run.rrd").csv is None
