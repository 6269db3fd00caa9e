"""Makes small pictures with ICC profiles or colour chunks, and what LittleCMS makes of them, for the tests in
src/render/formats/srgb_picture.rs and src/render/scene/color.rs.

    pip install pillow==13.0.0      # with LittleCMS 2.19
    python3 convert.py

NAME.png or NAME.jpg has the codes, and NAME.srgb.png what ImageCms.profileToProfile makes of them: to LittleCMS's own
sRGB profile, 8 bits, relative colorimetric, without black point compensation. The profiles are written below, number by
number, so that their source is known. A name in REFUSED has no converted picture.
"""

import io
import pathlib
import struct

from PIL import Image, ImageCms, PngImagePlugin

HERE = pathlib.Path(__file__).parent
D50 = (0.9642, 1.0, 0.8249)
BRADFORD = ((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296))
D65 = (0.3127, 0.3290)
REC709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))
PROPHOTO = ((0.734699, 0.265301), (0.159597, 0.840403), (0.036598, 0.000105))


def dot(m, v):
    return [sum(a * b for a, b in zip(row, v)) for row in m]


def mul(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def inverse(m):
    (a, b, c), (d, e, f), (g, h, i) = m
    det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    adj = ((e * i - f * h, c * h - b * i, b * f - c * e), (f * g - d * i, a * i - c * g, c * d - a * f),
           (d * h - e * g, b * g - a * h, a * e - b * d))
    return [[x / det for x in row] for row in adj]


def xyz(x, y):
    return [x / y, 1.0, (1 - x - y) / y]


def colorants(white, primaries):
    """Columns: XYZ of red, green and blue, adapted to D50 by Bradford."""
    columns = [list(row) for row in zip(*[xyz(*p) for p in primaries])]
    weights = dot(inverse(columns), xyz(*white))
    scaled = [[columns[i][j] * weights[j] for j in range(3)] for i in range(3)]
    have, want = dot(BRADFORD, xyz(*white)), dot(BRADFORD, D50)
    adapt = mul(inverse(BRADFORD), [[BRADFORD[i][j] * want[i] / have[i] for j in range(3)] for i in range(3)])
    return mul(adapt, scaled)


def fixed(value):
    return struct.pack(">i", round(value * 65536))


def xyz_tag(v):
    return b"XYZ \0\0\0\0" + b"".join(map(fixed, v))


def para(kind, *numbers):
    return b"para\0\0\0\0" + struct.pack(">HH", kind, 0) + b"".join(map(fixed, numbers))


def curv(*values):
    return b"curv\0\0\0\0" + struct.pack(f">I{len(values)}H", len(values), *values)


def text(words):
    return b"mluc\0\0\0\0" + struct.pack(">IIHHII", 1, 12, 0x656E, 0x5553, 2 * len(words), 28) + words.encode("utf-16-be")


def profile(space, tags, version=4, pcs=b"XYZ ", kind=b"mntr"):
    tags = {b"desc": text("test"), b"cprt": text("none"), b"wtpt": xyz_tag(D50), **tags}
    table, data = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for name, tag in tags.items():
        tag += b"\0" * (-len(tag) % 4)
        table += name + struct.pack(">II", start + len(data), len(tag))
        data += tag
    body = struct.pack(">I", len(tags)) + table + data
    head = struct.pack(">I4sI4s4s4s", 128 + len(body), b"\0" * 4, version << 24, kind, space, pcs)
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + b"\0" * 28 + b"".join(map(fixed, D50))
    return head.ljust(128, b"\0") + body


def rgb(primaries, curve, white=D65, version=4, **other):
    m = colorants(white, primaries)
    columns = {name: xyz_tag([row[k] for row in m]) for k, name in enumerate((b"rXYZ", b"gXYZ", b"bXYZ"))}
    curves = {name: curve for name in (b"rTRC", b"gTRC", b"bTRC")}
    return profile(b"RGB ", {**columns, **curves, **other}, version)


def srgb(x):
    return ((x + 0.055) / 1.055) ** 2.4 if x > 0.04045 else x / 12.92


SRGB_CURVE = para(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
TABLE = curv(*(round(65535 * srgb(k / 1023)) for k in range(1024)))
SHORT = curv(*(round(65535 * (k / 40) ** 2.4) for k in range(41)))
PROFILES = {
    "p3": rgb(P3, SRGB_CURVE),
    "adobe": rgb(ADOBE, curv(563), version=2),
    "prophoto": rgb(PROPHOTO, curv(461), white=(0.345704, 0.358540)),
    "srgb-table": rgb(REC709, TABLE, version=2),
    "short-table": rgb(REC709, SHORT),
    "linear": rgb(P3, curv()),
    "power": rgb(P3, para(0, 1.9)),
    "cut-power": rgb(REC709, para(1, 2.1, 1.1, -0.1)),
    "raised-power": rgb(REC709, para(2, 2.1, 0.95, -0.05, 0.05)),
    "seven": rgb(P3, para(4, 2.2, 0.9, 0.08, 0.25, 0.05, 0.02, 0.004)),
}


def colors():
    """512 colours and 64 greys, one a pixel."""
    steps = (0, 7, 30, 64, 110, 160, 210, 255)
    cube = [(r, g, b) for r in steps for g in steps for b in steps]
    image = Image.new("RGB", (32, 18))
    image.putdata(cube + [(4 * k + 3,) * 3 for k in range(64)])
    return image


def patches():
    """Patches of 8 x 8 px, which JPEG at full quality keeps."""
    steps = (0, 60, 140, 200, 255)
    cube = [(r, g, b) for r in steps for g in steps for b in steps]
    image = Image.new("RGB", (25, 5))
    image.putdata(cube)
    return image.resize((200, 40), Image.Resampling.NEAREST)


def converted(image, icc):
    source = ImageCms.ImageCmsProfile(io.BytesIO(icc))
    target = ImageCms.createProfile("sRGB")
    intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
    return ImageCms.profileToProfile(image, source, target, intent, outputMode="RGB", flags=ImageCms.Flags.NONE)


def chunked(name, icc, *chunks):
    """A PNG with colour chunks in place of the profile that says the same."""
    info = PngImagePlugin.PngInfo()
    for kind, data in chunks:
        info.add(kind, data)
    colors().save(HERE / f"{name}.png", pnginfo=info)
    converted(colors(), icc).save(HERE / f"{name}.srgb.png")


def main():
    for name, icc in PROFILES.items():
        colors().save(HERE / f"{name}.png", icc_profile=icc)
        converted(colors(), icc).save(HERE / f"{name}.srgb.png")
    options = {"quality": 100, "subsampling": 0, "icc_profile": PROFILES["p3"]}
    file = io.BytesIO()
    patches().save(file, "JPEG", **options)
    (HERE / "p3-jpeg.jpg").write_bytes(file.getvalue())
    converted(Image.open(file), PROFILES["p3"]).save(HERE / "p3-jpeg.srgb.png")

    grey = colors().convert("L")
    greys = {"grey-power": (curv(563), b"XYZ "), "grey-table": (SHORT, b"XYZ "),
             "grey-lab": (curv(), b"Lab "), "grey-lab-power": (curv(300), b"Lab ")}
    for name, (curve, pcs) in greys.items():
        icc = profile(b"GRAY", {b"kTRC": curve}, 2, pcs)
        grey.save(HERE / f"{name}.png", icc_profile=icc)
        converted(grey, icc).save(HERE / f"{name}.srgb.png")

    points = [round(1e5 * v) for xy in (D65, *P3) for v in xy]
    chromaticities = (b"cHRM", struct.pack(">8I", *points))
    chunked("chunk-gamma", rgb(REC709, para(0, 1 / 0.55)), (b"gAMA", struct.pack(">I", 55000)))
    chunked("chunk-p3", rgb(P3, SRGB_CURVE), (b"gAMA", struct.pack(">I", 45455)), chromaticities)
    chunked("chunk-cicp", rgb(P3, SRGB_CURVE), (b"cICP", bytes([12, 13, 0, 1])))

    video = para(3, 1 / 0.45, 1 / 1.099, 0.099 / 1.099, 1 / 4.5, 0.081)
    chunked("chunk-video", rgb(REC709, video), (b"cICP", bytes([1, 1, 0, 1])))

    table = b"mft1\0\0\0\0" + bytes([3, 3, 2, 0]) + b"".join(map(fixed, (1, 0, 0, 0, 1, 0, 0, 0, 1)))
    table += bytes(range(256)) * 3 + bytes([0, 128, 128, 255, 128, 128] * 4) + bytes(range(256)) * 3
    refused = {
        "refused-table": profile(b"RGB ", {b"A2B0": table}, 2, b"Lab "),
        "refused-short": PROFILES["p3"][:200],
        "refused-grey": profile(b"GRAY", {b"kTRC": curv(563)}, 2),
    }
    for name, icc in refused.items():
        colors().crop((0, 0, 4, 4)).save(HERE / f"{name}.png", icc_profile=icc)
    cmyk = patches().crop((0, 0, 16, 16)).convert("CMYK")
    cmyk.save(HERE / "refused-cmyk.jpg", icc_profile=profile(b"CMYK", {b"A2B0": table}, 2, b"Lab ", b"prtr"))


if __name__ == "__main__":
    main()
