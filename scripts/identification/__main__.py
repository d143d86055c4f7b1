"""Run the studies of identification, and write their tables into the README of `impactlaw.identification`."""

from pathlib import Path
from typing import Literal

import tyro

from scripts.identification.chains import chains_table, paths_table, study_chains
from scripts.identification.drops import drops_table, measure
from scripts.identification.energy import energy_table
from scripts.identification.pictures import draw_paths
from scripts.options import Count

Study = Literal["drops", "chains", "energy"]
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "impactlaw" / "identification" / "README.md"
PICTURE = ROOT / ".pictures" / "hertz_chain.png"


def put(page: str, name: str, table: str) -> str:
    """Return the page with the text between the marks of this name replaced by the table."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    head, found, rest = page.partition(begin)
    if not found:
        raise SystemExit(f"{PAGE} has no mark {begin.strip()}")
    return head + begin + "\n" + table + "\n\n" + end + rest.partition(end)[2]


def main(what: tyro.conf.Positional[tuple[Study, ...]] = ("drops", "chains"), count: Count = 100_000) -> None:
    """Run studies, and write their tables into the page.

    Args:
        what: the studies to run.
        count: random collisions per law of the study "energy".
    """
    for study in what:
        if study == "drops":
            table = drops_table(measure())
        elif study == "chains":
            table = chains_table(study_chains()) + "\n\n" + paths_table()
            draw_paths(PICTURE)
        else:
            table = energy_table(count)
        PAGE.write_text(put(PAGE.read_text(encoding="utf-8"), study, table), encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
