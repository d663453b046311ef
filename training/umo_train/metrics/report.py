"""Writes the measurements: `report.json`, and a self-contained page `report.html`."""

import base64
import html
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from umo_train.metrics import plots, sheet
from umo_train.metrics.bars import Bar, judge
from umo_train.metrics.measure import Made, Measured, Subject

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#2d3742;max-width:1080px;margin:2rem auto;padding:0 1rem}
h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.15rem;margin:2rem 0 .6rem;border-bottom:1px solid #dfe4e8}
table{border-collapse:collapse;margin:.4rem 0}td,th{padding:.25rem .8rem .25rem 0;text-align:left;vertical-align:top}
th{font-weight:600;color:#62707d;font-size:.85rem}td.n{text-align:right;font-variant-numeric:tabular-nums}
.met{color:#1d7a46;font-weight:600}.missed{color:#c0392b;font-weight:600}.note{color:#7b8794;font-size:.85rem}
.row{display:flex;flex-wrap:wrap;gap:1rem}.row>*{flex:1 1 30rem}svg,img{max-width:100%;height:auto}
"""


def _number(value: Any) -> str:
    if value is None:
        return "not measured"
    return f"{value:.4g}" if isinstance(value, float) else html.escape(str(value))


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    def cell(value: Any) -> str:
        if isinstance(value, str):
            return f"<td>{value}</td>"
        return f'<td class="n">{_number(value)}</td>'

    body = "".join("<tr>" + "".join(map(cell, row)) + "</tr>" for row in rows)
    return "<table><tr>" + "".join(f"<th>{html.escape(name)}</th>" for name in head) + f"</tr>{body}</table>"


def _judged(bars: Sequence[Bar]) -> str:
    rows = [
        (
            html.escape(bar.name),
            bar.value,
            f"{'&ge;' if bar.at_least else '&le;'} {bar.bar:g}",
            '<span class="met">met</span>' if bar.met else '<span class="missed">missed</span>',
            f'<span class="note">{html.escape(bar.note)}</span>',
        )
        for bar in bars
    ]
    return _table(("what", "measured", "bar", "", ""), rows)


def _nested(group: dict[str, Any]) -> str:
    """Rows of a group whose values are groups of the same keys, or plain numbers."""
    if all(isinstance(value, dict) for value in group.values()):
        keys = [key for key, value in next(iter(group.values())).items() if not isinstance(value, dict | list)]
        rows = [[html.escape(name), *(value.get(key) for key in keys)] for name, value in group.items()]
        return _table(["", *(key.replace("_", " ") for key in keys)], rows)
    plain = {key: value for key, value in group.items() if not isinstance(value, dict | list)}
    nested = {key: value for key, value in group.items() if isinstance(value, dict)}
    out = _table(("", ""), [(html.escape(key.replace("_", " ")), value) for key, value in plain.items()])
    for key, value in nested.items():
        if value and not any(isinstance(inner, list) for inner in value.values()):
            out += f"<p class=note>{html.escape(key.replace('_', ' '))}</p>" + _nested(value)
    return out


def _picture(made: Made) -> str:
    held = io.BytesIO()
    sheet.draw(made.item, made.motion).savefig(held, dpi=80, format="png")
    data = base64.b64encode(held.getvalue()).decode()
    return f'<img alt="{html.escape(made.item.name)}" src="data:image/png;base64,{data}">'


_TITLES = {
    "mouth": "Mouth, held-out speech",
    "real_mouth": "Mouth, real speech",
    "captured_mouth": "Mouth, captured ones",
    "beat": "Beat constancy, held-out speech",
    "real_beat": "Beat constancy, real speech",
    "fgd": "Frechet gesture distance",
    "variety": "Diversity and prompts",
    "actions": "Actions from text",
    "body": "Body, real speech without a prompt",
    "model": "Smoothness of the model",
    "performer": "Smoothness of the performer",
    "tokens": "Codes and experts",
    "speed": "Speed",
}


def _plots(name: str, measured: Measured) -> list[str]:
    group = measured.groups[name]
    model = [m.motion for m in (*measured.held_out, *measured.real)]
    if name == "mouth":
        return [plots.mouth_histogram(model, measured.performer), *map(plots.mouth_over_wave, measured.held_out[:2])]
    if name == "real_mouth":
        return [plots.lags(group), *map(plots.mouth_over_wave, measured.real[:2])]
    if name in ("beat", "real_beat"):
        return [
            plots.bars(
                {key.replace("_", " "): value["ratio"] for key, value in group.items()},
                "own audio over shifted audio",
                1,
            )
        ]
    if name == "fgd":
        kept = ("model", "with_layers", "performer_again", "shuffled_chunks", "random_codes")
        return [plots.bars({k.replace("_", " "): group[k] for k in kept if group.get(k) is not None}, "FGD")]
    if name == "model":
        return [plots.speed_histogram(model, measured.performer)]
    if name == "tokens" and group.get("expert_use"):
        return [plots.shares(group["expert_use"])]
    return []


def write(folder: Path, subject: Subject, measured: Measured, about: dict[str, Any], sheets: int = 3) -> list[Bar]:
    """Writes both files into a folder, with the contact sheets of the first recordings, and returns the bars."""
    folder.mkdir(parents=True, exist_ok=True)
    bars = judge(measured.groups)
    about = {"model": subject.model.name if subject.model else "the program's own"} | about
    said = {"about": about, "bars": [asdict(bar) | {"met": bar.met} for bar in bars], "measures": measured.groups}
    (folder / "report.json").write_text(json.dumps(said, indent=1) + "\n")

    circumstances = ", ".join(f"{key} {value}" for key, value in about.items() if key != "model")
    met = sum(bar.met for bar in bars)
    parts = [
        f"<h1>{html.escape(str(about['model']))}</h1>",
        f"<p class=note>{html.escape(circumstances)}</p>",
        f"<h2>Bars: {met} of {len(bars)} met</h2>{_judged(bars)}",
    ]
    for name, title in _TITLES.items():
        if measured.groups.get(name):
            pictures = "".join(f"<div>{svg}</div>" for svg in _plots(name, measured))
            parts.append(f"<h2>{title}</h2>{_nested(measured.groups[name])}<div class=row>{pictures}</div>")
    shown = [*measured.real[:sheets], *measured.held_out[: max(sheets - len(measured.real), 0)]]
    if shown:
        parts.append("<h2>Contact sheets</h2>" + "".join(map(_picture, shown)))
    page = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>umo: evaluation</title><style>{_STYLE}</style>'
    (folder / "report.html").write_text(page + "\n".join(parts) + "</html>\n")
    return bars
