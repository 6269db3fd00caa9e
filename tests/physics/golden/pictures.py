"""Makes the photographs of the golden scenes, src/render/shard/golden_pictures.

    pip install pillow==13.0.0
    python3 tests/physics/golden/pictures.py

Other versions of Pillow may write other bytes, and so change the digests of src/render/shard/golden.rs.
"""

import pathlib
import random
import sys

from PIL import Image, ImageChops, ImageDraw, ImageFilter

ROOT = pathlib.Path(__file__).parents[3]
sys.path.insert(0, str(ROOT / "tests/formats/icc"))
from convert import PROFILES  # noqa: E402

OUT = ROOT / "src/render/shard/golden_pictures"


def picture(seed, size):
    """Shapes of saturated colours, and noise."""
    draw = random.Random(seed)
    width, height = size
    image = Image.new("RGB", size, (90, 120, 150))
    pen = ImageDraw.Draw(image)
    for _ in range(14):
        x, y = draw.randrange(width), draw.randrange(height)
        color = tuple(draw.choice((0, 40, 128, 255)) for _ in range(3))
        pen.rectangle((x, y, x + draw.randrange(3, 20), y + draw.randrange(3, 20)), fill=color)
    image = image.filter(ImageFilter.GaussianBlur(0.6))
    noise = Image.new("RGB", size)
    noise.putdata([tuple(draw.randrange(24) for _ in range(3)) for _ in range(width * height)])
    return ImageChops.add(image, noise)


def main():
    OUT.mkdir(exist_ok=True)
    # Odd sizes and halved colours reach the borders of the decoder's blocks.
    picture(1, (47, 39)).save(OUT / "progressive.jpg", quality=80, subsampling=2, progressive=True)
    picture(2, (32, 24)).save(OUT / "p3.png", icc_profile=PROFILES["p3"])
    exif = Image.Exif()
    exif[0x112] = 6
    picture(3, (39, 47)).save(OUT / "turned.jpg", quality=90, subsampling=1, exif=exif)


if __name__ == "__main__":
    main()
