"""The command line: compare, inspect, identify, study, plan, laws, scenes."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

import impactlaw
from impactlaw.comparison import Comparison
from impactlaw.errors import ImpactLawError, RecordingError, SceneError, StudyError, check_installed
from impactlaw.signals import ended_by_signals
from impactlaw.wording import in_options, warnings_of


@dataclass(frozen=True, kw_only=True)
class Compare(Comparison):
    """Simulate a scene under impact laws and under MuJoCo's soft contacts, and put the outcomes side by side."""

    out: Path | None = None
    """Folder for table, picture and recordings; out/<scene> if not given."""

    def __call__(self) -> None:
        """Simulate, write the files and print the table."""
        from impactlaw.comparison.compare import compare, format_table
        from impactlaw.comparison.new_files import new_files_in

        out = Path("out") / Path(self.scene).stem if self.out is None else self.out
        with new_files_in(out) as folder:
            table = compare(self, folder)
            written = sorted(path.name for path in folder.iterdir())
        print(in_options(format_table(table), self))
        print(f"\nin {out}: {', '.join(written)}")


@dataclass(frozen=True)
class Inspect:
    """Print the properties, contact pairs and collisions of a recording."""

    file: Annotated[Path, tyro.conf.Positional]
    """A recording, run.rrd."""
    csv: Path | None = None
    """Also write the collisions to this CSV file; its name must not end with .rrd, as those of recordings do."""

    def __call__(self) -> None:
        """Read the recording and print it."""
        from impactlaw.recording import describe, read_log

        if self.csv is not None:
            _check_other_file(self.csv, self.file)
        recording = read_log(self.file)
        print(describe(recording))
        if self.csv is not None:
            try:
                recording.collisions.to_csv(self.csv, index=False)
            except OSError as error:
                raise RecordingError(f"cannot write {self.csv}: {error.strerror or error}") from None


def _check_other_file(csv: Path, recording: Path) -> None:
    """Raise `RecordingError` if a table would be written over a recording."""
    if csv.suffix.lower() == ".rrd":
        raise RecordingError(f"the collisions are written as CSV, but {csv} ends with .rrd, as recordings do")
    if csv.exists() and recording.exists() and csv.samefile(recording):
        raise RecordingError(f"{csv} is the recording that is read; write the collisions to another file")


@dataclass(frozen=True)
class Identify:
    """Fit laws to measured or simulated collisions, and write the best one as JSON, which `make_law` reads."""

    file: Annotated[Path, tyro.conf.Positional]
    """A recording (.rrd), or a table (.csv, .parquet); see `impactlaw.identification.read_collisions`."""
    family: str | None = None
    """One family of laws: moreau, newton, poisson, reversal, fremond, coulomb, routh or compliant; all if not given."""
    folds: int | None = None
    """Number of parts into which the collisions are split; each part is predicted by a law fitted to the others. If not
    given, 5, or the number of collisions if that is smaller; the report says how many."""
    contacts: tuple[str, ...] | None = None
    """Labels of closed contacts: only collisions of exactly these are used; all collisions if not given."""
    out: Path | None = None
    """File of the law; the picture is beside it. out/<file>/law.json if not given."""

    def __call__(self) -> None:
        """Read the file, print the table and write law and picture."""
        from impactlaw.comparison.new_files import new_files_in
        from impactlaw.errors import MeasurementError
        from impactlaw.identification.report import draw, format_study, study, write_law

        out = Path("out") / self.file.stem / "law.json" if self.out is None else self.out
        if out.suffix != ".json":
            raise MeasurementError(f"the law is written as JSON, but {out} does not end with .json")
        check_installed("matplotlib", "the picture of a fit")
        found = study(self.file, family=self.family, folds=self.folds, contacts=self.contacts)
        assert found.best.law is not None
        with new_files_in(out.parent) as folder:
            write_law(found.best.law, folder / out.name, self.file.name)
            title = f"{self.file.name}: {len(found.measured.collisions)} collisions"
            draw(found, folder / out.with_suffix(".png").name, title)
        print(format_study(found))
        print(f"written: {out}, {out.with_suffix('.png')}")


@dataclass(frozen=True)
class RunStudy:
    """Let policies made for some laws act under others, and print the cost: transfer matrices and regrets.

    Finished cells are kept in the folder: the same command goes on where it was stopped. A law is "moreau:0.5",
    "maximal-dissipation", a law.json, "moreau:0.4..1" or "moreau|reversal:0.8" for one drawn per episode, or "mujoco".
    """

    tasks: tuple[str, ...] | None = None
    """Ids of environments in gymnasium, such as impactlaw/Juggler-v0 or Hopper-v5."""
    act: tuple[str, ...] | None = None
    """Laws under which the policies act."""
    train: tuple[str, ...] | None = None
    """Laws for which policies are made; the laws of --act if not given."""
    policies: tuple[str, ...] | None = None
    """Policies: ppo, which is trained (the default), scripted, module:name, or a file.zip of stable-baselines3."""
    schemes: tuple[Literal["soft", "time-stepping", "event-driven"], ...] | None = None
    """Ways to step; the usual one of each task if not given."""
    seeds: tuple[int, ...] | None = None
    """Seeds of trainings and of episodes; 0 1 2 if not given."""
    episodes: int | None = None
    """Episodes of each cell of the table; 20 if not given."""
    steps: int | None = None
    """Timesteps of each training, in whole rollouts of 16 384; 100 000 if not given."""
    quick: bool = False
    """Run the scripted controllers on this package's own tasks; none of the options above can be given."""
    backend: str = "loky"
    """Where cells run: loky (processes of this machine), dask, ray, or another backend of joblib."""
    address: str | None = None
    """Address of the cluster's scheduler; one on this machine is started if not given."""
    jobs: int = -1
    """Number of cells that run at the same time; -1 for one per processor."""
    out: Path = Path("out/study")
    """Folder for cells, policies, tables and pictures."""

    def __call__(self) -> None:
        """Run the study, write tables and pictures, and print the matrices."""
        from impactlaw.studies import Study, quick_study, run
        from impactlaw.studies.report import report

        names = ("tasks", "act", "train", "policies", "schemes", "seeds", "episodes", "steps")
        given: dict[str, Any] = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        check_installed("matplotlib", "the picture of a study")
        if self.quick and given:
            raise StudyError(f"--quick is a study of its own: leave it out, or --{', --'.join(given)}")
        if not self.quick and not {"tasks", "act"} <= set(given):
            raise StudyError("state --tasks and --act, or --quick")
        study = quick_study() if self.quick else Study(**given)
        table = run(study, self.out, backend=self.backend, address=self.address, jobs=self.jobs)
        print(report(table, self.out))


@dataclass(frozen=True)
class Laws:
    """List the impact laws, one line each."""

    def __call__(self) -> None:
        """Print the laws."""
        from impactlaw.laws import DESCRIPTIONS

        for name, text in DESCRIPTIONS.items():
            print(f"{name:<21}{text}")


@dataclass(frozen=True)
class Scenes:
    """List the scenes, one line each."""

    def __call__(self) -> None:
        """Print the scenes."""
        from impactlaw.models import SCENES

        for name, text in SCENES.items():
            print(f"{name:<17}{text}")


@dataclass(frozen=True)
class Plan:
    """Print what a step of a scene does, what it leaves out, and why."""

    scene: Annotated[str, tyro.conf.Positional]
    """Name of a scene (see `impactlaw scenes`) or path of an MJCF file."""
    contact_model: Literal["rigid", "soft"] = "rigid"
    """Whether sustained contact obeys the law (rigid) or MuJoCo (soft)."""
    scheme: Literal["event-driven", "time-stepping"] | None = None
    """How rigid contact is stepped; event-driven if not given."""
    friction: Literal["coulomb", "convex", "ignore"] | None = None
    """Friction of rigid contacts and soft collisions: exact Coulomb friction (the default), its relaxation, or none."""

    def __call__(self) -> None:
        """Print the plan."""
        from impactlaw.models import load
        from impactlaw.stepping.cautions import cautions
        from impactlaw.stepping.compatibility import check_rigid, check_scene_friction, check_time_stepping
        from impactlaw.stepping.plan import format_plan, make_plan

        model, _ = load(self.scene)
        if self.contact_model == "rigid":
            (check_time_stepping if self.scheme == "time-stepping" else check_rigid)(model)
        if self.contact_model == "soft" and self.scheme is not None:
            raise SceneError("scheme means nothing to soft steps; leave it out")
        friction = self.friction or "coulomb"
        plan = make_plan(model, self.contact_model, scheme=self.scheme, friction=friction)
        check_scene_friction(model, plan)
        print(format_plan(plan))
        for caution in cautions(model) if plan.scheme == "time-stepping" else ():
            print(f"caution   {caution}")


Command = (
    Annotated[Compare, tyro.conf.subcommand("compare")]
    | Annotated[Inspect, tyro.conf.subcommand("inspect")]
    | Annotated[Identify, tyro.conf.subcommand("identify")]
    | Annotated[RunStudy, tyro.conf.subcommand("study")]
    | Annotated[Plan, tyro.conf.subcommand("plan")]
    | Annotated[Laws, tyro.conf.subcommand("laws")]
    | Annotated[Scenes, tyro.conf.subcommand("scenes")]
)


def main() -> None:
    """Run the command line; an `ImpactLawError`, or a path that cannot be reached, becomes one line and exit code 2.

    The line is on standard error. The exit code is 1 if the output is closed, as by ``| head``, and, with a one-line
    message, if it cannot be written, as on a full disk. It is 130 after Ctrl-C and 143 after SIGTERM.
    """
    command: Any = None
    try:
        with ended_by_signals():
            if sys.argv[1:] == ["--version"]:
                print(f"impactlaw {impactlaw.__version__}")
                return
            command = tyro.cli(
                Command,  # pyright: ignore[reportArgumentType]
                prog="impactlaw",
                description="Exact, chosen multi-contact impact laws for MuJoCo scenes. --version prints the version.",
                config=(tyro.conf.OmitSubcommandPrefixes,),
            )
            sys.path.append(os.fspath(Path.cwd()))  # where laws and policies of the user's own may be
            with warnings_of(command):
                command()
            print(end="", flush=True)  # no error if there is no standard output
    except ImpactLawError as error:
        print(f"impactlaw: {in_options(str(error), command)}", file=sys.stderr)
        sys.exit(2)
    except OSError as error:
        if error.filename is not None:  # of a file or folder that cannot be reached, not of the output
            print(f"impactlaw: cannot reach {error.filename}: {error.strerror}", file=sys.stderr)
            sys.exit(2)
        if not isinstance(error, BrokenPipeError):
            print(f"impactlaw: cannot write the output: {error.strerror}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python's flush at exit reports an error
        sys.exit(1)


if __name__ == "__main__":
    main()
