"""Puts small pictures of the same size into one: sheet.py OUTPUT COLUMNS PICTURE... Below each picture stands the name of its file."""

import pathlib
import sys

from PIL import Image, ImageDraw, ImageFont

GAP, LABEL = 4, 16
output, columns, *files = sys.argv[1:]
columns = int(columns)
pictures = [Image.open(file).convert("RGB") for file in files]
width, height = pictures[0].size
rows = -(-len(files) // columns)
sheet = Image.new("RGB", (columns * (width + GAP) - GAP, rows * (height + LABEL)), "white")
draw = ImageDraw.Draw(sheet)
for i, (file, picture) in enumerate(zip(files, pictures)):
    x, y = i % columns * (width + GAP), i // columns * (height + LABEL)
    sheet.paste(picture, (x, y))
    draw.text((x + 2, y + height + 1), pathlib.Path(file).stem, fill="black", font=ImageFont.load_default(11))
sheet.quantize(256).save(output, optimize=True)
