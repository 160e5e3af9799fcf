#!/usr/bin/env python3
"""Makes `tests/import/images/whole`: images that Pillow writes, each with a PNG of the pixels
that Pillow reads from it.

    `python tests/import/images/whole.py`

Needs Pillow.
"""

import pathlib
import random

from PIL import Image

directory = pathlib.Path(__file__).with_name("whole")
directory.mkdir(exist_ok=True)
WIDTH, HEIGHT = 19, 11
noise = random.Random(1)
rgb = Image.new("RGB", (WIDTH, HEIGHT))
rgb.putdata([(x * 13, y * 20, noise.choice([0, 85, 170])) for y in range(HEIGHT) for x in range(WIDTH)])
opacity = Image.new("L", (WIDTH, HEIGHT))
opacity.putdata([noise.choice([0, 100, 255, 255]) for _ in range(WIDTH * HEIGHT)])
rgba = rgb.copy()
rgba.putalpha(opacity)
gray = rgb.convert("L")
palette = rgb.quantize(200, dither=Image.Dither.NONE)
few = rgb.quantize(9, dither=Image.Dither.NONE)
deep = Image.new("I;16", (WIDTH, HEIGHT))
deep.putdata([noise.randrange(65536) for _ in range(WIDTH * HEIGHT)])
masked = palette.copy()
masked.info["transparency"] = 3


def save(name, image, mode, **options):
    path = directory / name
    image.save(path, **options)
    with Image.open(path) as read:
        (read if mode == read.mode else read.convert(mode)).save(f"{path}.png", optimize=True)


save("bits.bmp", rgb.convert("1"), "RGB")
save("gray.bmp", gray, "RGB")
save("palette.bmp", palette, "RGB")
save("rgb.bmp", rgb, "RGB")
save("interlaced.gif", masked, "RGBA", interlace=True)
save("plain.gif", few, "RGBA", interlace=False)
save("frames.gif", palette, "RGBA", save_all=True, append_images=[few], comment="two frames")
save("bits.pbm", rgb.convert("1"), "L")
save("gray.pgm", gray, "L")
save("deep.pgm", deep, "I;16")
save("rgb.ppm", rgb, "RGB")
save("gray.tga", gray, "L", rle=True)
save("gray_alpha.tga", rgba.convert("LA"), "LA", rle=True)
save("palette.tga", palette, "RGB", rle=True)
save("rgb.tga", rgb, "RGB")
save("rgba.tga", rgba, "RGBA", rle=True, orientation=1)
save("rgba.qoi", rgba, "RGBA")
save("frames.webp", rgba, "RGBA", save_all=True, append_images=[rgb.convert("RGBA")], lossless=True)
