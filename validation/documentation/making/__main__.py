"""See the package; two processes share the work."""

from __future__ import annotations

import re
import shutil
import sys
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path

import matplotlib as mpl

from making.blocks import with_outputs
from making.cases import draw_cases, write_cases
from making.equations import equations
from making.look_up import benchmarks, commands, exit_codes, faults, keys, laws, metrics, studies
from making.third_party import third_party

ROOT = Path(__file__).parents[3]
HERE = ROOT / "validation" / "documentation"
EXAMPLES = ROOT / "validation" / "examples"


def main() -> None:
    """Write all of them into the folder of the command line."""
    mpl.use("Agg")
    folder = Path(sys.argv[1])
    made = folder / "made"
    (made / "cases").mkdir(parents=True, exist_ok=True)
    pages = [page for page in sorted(folder.rglob("*.md")) if "<!-- run" in page.read_text("utf-8")]
    with ProcessPoolExecutor() as pool:
        started: list[Future[None]] = [pool.submit(_run_page, page, folder) for page in pages]
        started.append(pool.submit(draw_cases, made))
        _draw_in_place(folder / "architecture.md")
        write_cases(made)
        _write_pages(made)
        for each in started:
            each.result()


def _run_page(page: Path, folder: Path) -> None:
    text = with_outputs(str(page.relative_to(folder)), page.read_text("utf-8"))
    page.write_text(text, encoding="utf-8")


def _draw_in_place(page: Path) -> None:
    """A drawing as part of the page, so that it follows the theme's colours."""
    text = page.read_text("utf-8")
    for shown, name in re.findall(r"(!\[[^]]*\]\(([\w.]+\.svg)\))", text):
        text = text.replace(shown, f"```{{raw}} html\n:file: {name}\n```")
    page.write_text(text, encoding="utf-8")


def _write_pages(made: Path) -> None:
    for name, text in {
        "equations": equations(HERE / "equations.toml"),
        "keys": keys(),
        "metrics": metrics(),
        "laws": laws(),
        "faults": faults(),
        "studies": studies(),
        "benchmarks": benchmarks(),
        "exit_codes": exit_codes(),
        "commands": commands(),
        "third_party": third_party(),
    }.items():
        (made / f"{name}.md").write_text(text, encoding="utf-8")
    demos = sorted(EXAMPLES.glob("*.py"))
    for demo in demos:
        shutil.copy(demo, made / demo.name)
    names = "\n".join(demo.stem for demo in demos)
    (made / "demos.md").write_text(
        f"# Worked examples\n\nExecuted when this was made.\n\n```{{toctree}}\n{names}\n```\n",
        encoding="utf-8",
    )
    shutil.copy(ROOT / "CHANGELOG.md", made / "changelog.md")
    shutil.copy(ROOT / ".github" / "CONTRIBUTING.md", made / "contributing.md")
    shutil.copy(ROOT / "validation" / "report" / "kidney.png", made / "kidney.png")


if __name__ == "__main__":
    main()
