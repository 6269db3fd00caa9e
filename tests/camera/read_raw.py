"""Opens each raw.dng below a folder of tuples with LibRaw, and compares it with the file's numbers and with photo.jpg.

    read_raw.py RUN/tuples

Exit code 77: a package is not installed.
"""

import json
import pathlib
import struct
import sys

try:
    import numpy
    import rawpy
    from PIL import Image
except ImportError as error:
    print(f"skipped: raw.dng by rawpy: {error.name} is not installed")
    sys.exit(77)


def numbers(path):
    """The strip of the file, read without a library: TIFF 6.0, little endian, one directory."""
    data = path.read_bytes()
    (first,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, first)
    tags = {}
    for entry in range(count):
        tag, _, _, value = struct.unpack_from("<HHII", data, first + 2 + 12 * entry)
        tags[tag] = value
    width, height = tags[256], tags[257]
    return numpy.frombuffer(data, "<u2", width * height, tags[273]).reshape(height, width)


def coarse(picture):
    rows, columns = (side // 4 * 4 for side in picture.shape[:2])
    return picture[:rows, :columns].reshape(rows // 4, 4, columns // 4, 4, 3).mean(axis=(1, 3))


worst = 0.0
folders = sorted(path.parent for path in pathlib.Path(sys.argv[1]).glob("*/raw.dng"))
assert folders
for folder in folders:
    sensor = json.loads((folder / "tuple.json").read_text())["scene"]["sensor"]
    with rawpy.imread(str(folder / "raw.dng")) as raw:
        assert (raw.raw_image == numbers(folder / "raw.dng")).all(), folder
        assert raw.black_level_per_channel == [sensor["black_level_dn"]] * 4
        assert raw.white_level == 2 ** sensor["bits"] - 1
        gains = numpy.array(raw.camera_whitebalance[:3]) / raw.camera_whitebalance[1]
        assert numpy.allclose(gains, sensor["white_balance"], rtol=1e-4), (gains, sensor)
        letters = "".join("RGBG"[colour] for colour in raw.raw_pattern.flatten()).lower()
        assert letters == sensor["mosaic"], letters
        made = raw.postprocess(use_camera_wb=True, no_auto_bright=True, gamma=(2.4, 12.92), user_flip=0)
    photo = Image.open(folder / "photo.jpg").convert("RGB")
    photo = numpy.asarray(photo.resize((made.shape[1], made.shape[0])), float)
    # Curves, errors of white balance, sharpening and LibRaw's own interpolation differ; the colours and places do not. Means of
    # 4 x 4 px have less noise.
    made, photo = coarse(made.astype(float)), coarse(photo)
    for channel in range(3):
        correlation = numpy.corrcoef(made[..., channel].ravel(), photo[..., channel].ravel())[0, 1]
        worst = max(worst, 1 - correlation)
        assert correlation > 0.95, (folder, channel, correlation)
print(f"{len(folders)} raw files, correlations above {1 - worst:.3f}")
