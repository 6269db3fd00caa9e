"""Makes the pictures *.jpg and the verdicts of libjpeg-turbo on damaged copies of them, verdicts.csv, which the tests in
src/render/formats/jpeg/tests.rs compare with the reader's.

    apt-get install libjpeg-turbo-progs     # djpeg with -strict; the verdicts are those of 2.1.5
    pip install pillow==13.0.0
    python3 strict.py

A row is PICTURE,DAMAGE,AT,VERDICT,PIXELS. DAMAGE: `cut` (the first AT bytes, then an end marker), `scan` (without scan
AT), `flip` (bit AT of the file flipped). VERDICT: `whole`, or `refused` (an error or a warning). PIXELS: the largest
difference to the undamaged picture, or -1 without a picture of its size.
"""

import io
import pathlib
import random
import subprocess

from PIL import Image, ImageChops, ImageDraw, ImageFilter

HERE = pathlib.Path(__file__).parent
KINDS = {
    "baseline": {"mode": "RGB", "subsampling": 0},
    "halved": {"mode": "RGB", "subsampling": 2},
    "restarts": {"mode": "RGB", "subsampling": 2, "restart_marker_blocks": 3},
    "progressive": {"mode": "RGB", "subsampling": 2, "progressive": True},
    "grey": {"mode": "L", "progressive": True},
    "cmyk": {"mode": "CMYK"},
}


def picture(seed):
    """A picture of 61 x 45 px with shapes and noise."""
    draw = random.Random(seed)
    image = Image.new("RGB", (61, 45), (90, 120, 150))
    pen = ImageDraw.Draw(image)
    for _ in range(12):
        x, y = draw.randrange(61), draw.randrange(45)
        color = tuple(draw.randrange(256) for _ in range(3))
        pen.ellipse((x, y, x + draw.randrange(4, 30), y + draw.randrange(4, 30)), fill=color)
    image = image.filter(ImageFilter.GaussianBlur(0.7))
    noise = Image.new("RGB", image.size)
    noise.putdata([tuple(draw.randrange(24) for _ in range(3)) for _ in range(61 * 45)])
    return ImageChops.add(image, noise)


def djpeg(jpeg, strict):
    """The picture that djpeg makes, or None."""
    run = subprocess.run(
        ["djpeg", "-pnm"] + ["-strict"] * strict, input=jpeg, capture_output=True, check=False
    )
    try:
        return Image.open(io.BytesIO(run.stdout)).convert("RGB") if run.returncode in (0, 2) else None
    except (OSError, SyntaxError):
        return None


def strict_verdict(jpeg):
    run = subprocess.run(["djpeg", "-pnm", "-strict"], input=jpeg, capture_output=True, check=False)
    return "whole" if run.returncode == 0 else "refused"


def scans(jpeg):
    """The ranges of the scans, with the tables before each."""
    marks, at = [], 2
    while jpeg[at + 1] != 0xD9:
        marker, start = jpeg[at + 1], at
        at += 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
        if marker == 0xDA:
            while jpeg[at] != 0xFF or jpeg[at + 1] in (0, *range(0xD0, 0xD8)):
                at += 1
            marks.append((start, at))
    return marks


def main():
    rows = []
    for number, (name, keys) in enumerate(KINDS.items()):
        options = dict(keys)
        file = io.BytesIO()
        picture(number).convert(options.pop("mode")).save(file, "JPEG", quality=85, **options)
        jpeg = file.getvalue()
        (HERE / f"{name}.jpg").write_bytes(jpeg)
        sound = djpeg(jpeg, True)
        assert sound is not None, name
        draw = random.Random(100 + number)
        first = scans(jpeg)[0][0]
        damages = [("cut", draw.randrange(first + 14, len(jpeg) - 2)) for _ in range(40)]
        if options.get("progressive"):
            damages += [("scan", k) for k in range(len(scans(jpeg)))]
        damages += [("flip", draw.randrange(16, 8 * len(jpeg) - 16)) for _ in range(60)]
        for damage, at in damages:
            broken = bytearray(jpeg)
            if damage == "cut":
                broken = broken[:at] + b"\xff\xd9"
            elif damage == "scan":
                start, end = scans(jpeg)[at]
                del broken[start:end]
            else:
                broken[at // 8] ^= 128 >> at % 8
            image = djpeg(bytes(broken), False)
            pixels = -1
            if image is not None and image.size == sound.size:
                pixels = max(high for _, high in ImageChops.difference(image, sound).getextrema())
            rows.append(f"{name},{damage},{at},{strict_verdict(bytes(broken))},{pixels}")
    (HERE / "verdicts.csv").write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
