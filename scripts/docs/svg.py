"""Minimal SVG for the pictures in docs/img: text, lines, boxes, on a card that suits light and dark pages."""

from xml.sax.saxutils import escape

INK, FAINT, GRID, CARD = "#1f2933", "#5b6770", "#dde2e7", "#ffffff"
FONT = "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif"


class Picture:
    """A card of `width` x `height` pixels. Positions are in pixels from its upper left corner."""

    def __init__(self, width, height, title):
        self.width, self.height, self.title, self.parts = width, height, title, []

    def add(self, name, content=None, **attributes):
        written = "".join(f' {key.replace("_", "-")}="{number(value)}"' for key, value in attributes.items())
        self.parts.append(f"<{name}{written}/>" if content is None else f"<{name}{written}>{escape(content)}</{name}>")

    def text(self, x, y, content, size=12, anchor="start", fill=INK, **more):
        self.add("text", str(content), x=x, y=y, font_size=size, text_anchor=anchor, fill=fill, **more)

    def line(self, x1, y1, x2, y2, stroke=GRID, width=1, **more):
        self.add("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=stroke, stroke_width=width, **more)

    def box(self, x, y, width, height, fill, **more):
        self.add("rect", x=x, y=y, width=width, height=height, fill=fill, **more)

    def write(self, path):
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" width="{self.width}" '
            f'height="{self.height}" font-family="{FONT}" role="img">'
        )
        card = (
            f'<rect x="0.5" y="0.5" width="{self.width - 1}" height="{self.height - 1}" rx="8" fill="{CARD}" '
            f'stroke="{GRID}"/>'
        )
        path.write_text("\n".join([head, f"<title>{escape(self.title)}</title>", card, *self.parts, "</svg>"]) + "\n")


def number(value):
    """Rounds pixels to a tenth; leaves everything else unchanged."""
    return f"{value:.1f}".removesuffix(".0") if isinstance(value, float) else escape(str(value), {'"': "&quot;"})
