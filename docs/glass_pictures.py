#!/usr/bin/env python3
"""Makes docs/glass.jpg: I and R~ of one scene behind each glazing of docs/glass.md.

    pip install pillow
    docs/glass_pictures.py [--glasshouse target/release/glasshouse]
"""

import argparse
import re
import subprocess
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw

SIDE_PX, COLUMNS, LABEL_PX = 160, 4, 16
RECIPE = """
schema = "glasshouse.recipe/1"
name = "glass"
seed = 5

[film]
width = 160
height = 160
spp = 256
layers = ["input", "glass_reflection"]

[glass]
glazing = "{glazing}"
tilt_deg = [0, 25]

[back]
exposure_ev = 2

[sources.sample]
layout = "sample"
count = 4

[[split]]
name = "train"
pairs = {{ sample = 1 }}
"""


def main() -> None:
    """Renders the scene behind every glazing and joins the pictures."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--glasshouse", default=str(root / "target/release/glasshouse"))
    program = parser.parse_args().glasshouse
    names = re.findall(r"^\[glazing\.([a-z0-9.-]+)\]", (root / "src/line/glazings.toml").read_text(), re.M)
    rows = -(-len(names) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * 2 * SIDE_PX, rows * (SIDE_PX + LABEL_PX)), "white")
    draw = ImageDraw.Draw(sheet)
    for number, name in enumerate(sorted(names)):
        with tempfile.TemporaryDirectory() as folder:
            recipe = Path(folder, "glass.toml")
            recipe.write_text(RECIPE.format(glazing=name))
            subprocess.run([program, "run", str(recipe), "--out", f"{folder}/run", "-q"], check=True)
            tuple_folder = next(Path(folder, "run/tuples").iterdir())
            left, top = number % COLUMNS * 2 * SIDE_PX, number // COLUMNS * (SIDE_PX + LABEL_PX)
            for place, layer in enumerate(("input", "glass_reflection")):
                sheet.paste(Image.open(tuple_folder / f"{layer}.png"), (left + place * SIDE_PX, top + LABEL_PX))
            draw.text((left + 3, top + 2), name, fill="black")
    sheet.save(root / "docs/glass.jpg", quality=85, optimize=True)


if __name__ == "__main__":
    main()
