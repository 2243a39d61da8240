"""Run the snippets of the pages that draw, and keep their figures: ``python docs/draw.py [PAGE ...]``."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PAGES = ("branches.md", "how_do_i.md", "paper.md")


def draw(page: Path) -> None:
    """Run the snippets of a page that write a figure."""
    text = page.read_text(encoding="utf-8")
    for code in re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
        names = re.findall(r'savefig\("([\w.]+)"', code)
        if names:
            print(page.name, *names)
            environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": str(DOCS.parent)}
            with tempfile.TemporaryDirectory() as folder:
                # what else they write is not for the pages
                subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, check=True)
                for figure in names:
                    shutil.move(Path(folder) / figure, DOCS / "figures" / figure)


if __name__ == "__main__":
    for name in sys.argv[1:] or PAGES:
        draw(DOCS / name)
