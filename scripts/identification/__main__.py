"""Run the studies of identification, and write their tables into the README of `impactlaw.identification`."""

import argparse
from pathlib import Path

from scripts.identification.chains import chains_table, paths_table, study_chains
from scripts.identification.drops import drops_table, measure
from scripts.identification.energy import energy_table
from scripts.identification.pictures import draw_paths

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


def main() -> None:
    """Run the studies named on the command line."""
    parser = argparse.ArgumentParser(prog="python -m scripts.identification", description=__doc__)
    parser.add_argument("what", nargs="*", default=["drops", "chains"], help="drops, chains, energy")
    parser.add_argument("--every", type=int, default=1, help="take one of so many drops")
    parser.add_argument("--count", type=int, default=100_000, help="random collisions per law (energy)")
    arguments = parser.parse_args()
    for what in arguments.what:
        if what == "drops":
            table = drops_table(measure(every=arguments.every))
        elif what == "chains":
            table = chains_table(study_chains()) + "\n\n" + paths_table()
            draw_paths(PICTURE)
        elif what == "energy":
            table = energy_table(arguments.count)
        else:
            parser.error(f"unknown {what!r}; known: drops, chains, energy")
        PAGE.write_text(put(PAGE.read_text(encoding="utf-8"), what, table), encoding="utf-8")


if __name__ == "__main__":
    main()
