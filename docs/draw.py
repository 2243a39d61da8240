"""Run the snippets of the pages that draw, in the folder of their figures: ``python docs/draw.py [PAGE ...]``."""

import os
import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parent
PAGES = ("how_do_i.md", "paper.md")


def draw(page: Path) -> None:
    """Run the snippets of a page that write a figure."""
    text = page.read_text(encoding="utf-8")
    for code in re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
        names = re.findall(r'savefig\("([\w.]+)"', code)
        if names:
            print(page.name, *names)
            environment = os.environ | {"MPLBACKEND": "Agg"}
            subprocess.run([sys.executable, "-c", code], cwd=DOCS / "figures", env=environment, check=True)


if __name__ == "__main__":
    for name in sys.argv[1:] or PAGES:
        draw(DOCS / name)
