import json

import numpy as np
import pytest

from metrics_motion import still, swinging
from umo_train.metrics import report, sheet, table
from umo_train.metrics.bars import judge
from umo_train.metrics.item import Item
from umo_train.metrics.measure import Made, Measured, Subject, beats, mouth, real_mouth, smoothness
from umo_train.skeleton import SHAPE
from umo_train.speech.utterance import Phone


def talking(name: str, split: str, seed: int) -> Item:
    """A mouth that opens with the sound and closes at p."""
    phones, samples, motion = [], [], swinging(120, seed)
    rng = np.random.default_rng(seed)
    for i in range(8):
        start = i / 2
        phones += [Phone("p", start, start + 0.1), Phone("aa", start + 0.1, start + 0.5, 2)]
        samples += [np.zeros(1600), rng.normal(size=6400) * 0.1 * rng.uniform(0.5, 1)]
        motion["face"][round(start * 30) + 4 : round((start + 0.5) * 30), 6 + SHAPE["jawOpen"]] = 0.5
    return Item(name, "v", np.concatenate(samples).astype(np.float32), tuple(phones), motion, split=split)


@pytest.fixture(scope="module")
def measured() -> Measured:
    items = [talking(f"i{n}", "voice" if n % 2 else "sentence", n) for n in range(4)]
    out = Measured(held_out=[Made(item, item.motion) for item in items], performer=[item.motion for item in items])
    out.real = [Made(Item(item.name, item.voice, item.samples), item.motion) for item in items]
    out.groups = {
        "mouth": mouth(out.held_out),
        "real_mouth": real_mouth(out.real),
        "beat": beats(out.held_out),
        "real_beat": beats(out.real),
        "fgd": {"model": 1.0, "random_codes": 8.0, "shuffled_chunks": 1.9, "performer_again": None, "windows": 10},
        "model": smoothness([m.motion for m in out.held_out]),
        "tokens": {"chunks": 1, "agreement": {"face": 0.9, "all": 0.9}, "expert_use": {"encoder 0": [0.5, 0.5]}},
        "speed": {"first_frame_ms": 5.0, "chunk_ms": 10.0, "frames_per_second": 3000.0, "isa": "avx2", "threads": 2},
    }
    return out


def test_a_mouth_like_the_performers_meets_its_bars_and_a_still_one_does_not(measured):
    bars = {bar.name: bar for bar in judge(measured.groups)}
    assert bars["lip opening against the performer's, correlation"].value == pytest.approx(1)
    assert bars["lips closed within 1 frame at p b m"].met
    assert bars["real speech: mouth against envelope, correlation"].met
    mute = mouth([Made(made.item, still(120)) for made in measured.held_out])
    assert mute["voice"]["lip_correlation"] == 0
    # An always shut mouth reaches every closure, as the share by chance shows.
    assert mute["voice"]["closures"] == mute["voice"]["closures_by_chance"] == 1
    ajar = still(120)
    ajar["face"][:, 6 + SHAPE["jawOpen"]] = 0.4
    assert mouth([Made(made.item, ajar) for made in measured.held_out])["sentence"]["closures"] == 0


def test_bars_are_ratios_and_what_is_missing_is_missed(measured):
    bars = {bar.name: bar for bar in judge(measured.groups)}
    assert bars["FGD over that of random codes"].met
    assert not bars["FGD over that of shuffled chunks"].met
    assert not bars["codes of int8 as of f32"].met
    # No item has other takes, or a pause.
    assert bars["prompts told apart"].value is None and not bars["prompts told apart"].met
    assert bars["mouth still in pauses of 0.4 s and more"].value is None
    assert not any(bar.met for bar in judge({}))


def test_the_page_holds_everything_itself(measured, tmp_path, monkeypatch):
    subject = Subject(tmp_path / "umo", tmp_path / "model<1>.safetensors")
    bars = report.write(tmp_path / "out", subject, measured, {"items": 4}, sheets=1)
    said = json.loads((tmp_path / "out/report.json").read_text())
    assert [bar["met"] for bar in said["bars"]] == [bar.met for bar in bars]
    page = (tmp_path / "out/report.html").read_text()
    assert page.count("<svg") >= 8 and page.count("data:image/png;base64,") == 1
    assert 'class="missed"' in page and "model&lt;1&gt;" in page and "model<1>" not in page
    # Nothing is fetched; SVG namespaces are only names.
    assert 'src="http' not in page and "<link" not in page and "<script" not in page


def test_a_table_marks_the_best_of_each_column(tmp_path):
    for name, fgd, pauses in (("full", 1.5, 0.97), ("dense", 2.25, None)):
        groups = {
            "fgd": {"model": fgd},
            "mouth": {"a": {"pauses": pauses, "closures": 0.9}, "b": {"closures": fgd / 3}},
        }
        (tmp_path / name).write_text(json.dumps({"measures": groups}))
    text = table.table({"full": tmp_path / "full", "no experts": tmp_path / "dense"})
    assert text.splitlines() == [
        "|  | FGD ↓ | p b m closed ↑ | pauses still ↑ |",
        "| --- | ---: | ---: | ---: |",
        "| full | **1.50** | 0.500 | **0.970** |",
        "| no experts | 2.25 | **0.750** | – |",
    ]


def test_a_sheet_shows_what_moves(tmp_path):
    def pixels(motion: dict[str, np.ndarray]) -> np.ndarray:
        figure = sheet.draw(item, motion, poses=3, aside=False)
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3]

    item = talking("a", "", 0)
    moving, rest = pixels(item.motion), pixels(still(120))
    assert moving.shape == rest.shape and (moving.std() > 20)
    # Arms and faces differ in every third of the picture.
    assert all(
        (a != b).any(-1).mean() > 0.005
        for a, b in zip(np.array_split(moving, 3, 1), np.array_split(rest, 3, 1), strict=True)
    )
    sheet.save(item, item.motion, tmp_path / "a.png", dots_per_inch=30)
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
