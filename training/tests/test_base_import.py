import numpy as np
import pytest

import base_sources
from umo_train.data import corpus
from umo_train.data.clip import DataError
from umo_train.data.humanml3d import humanml3d, motion_name
from umo_train.data.imported import import_clips
from umo_train.lm.examples import Examples, Stream
from umo_train.motion.channels import weights


@pytest.fixture
def texts(tmp_path):
    base_sources.amass(tmp_path / "amass", tmp_path / "texts")
    return tmp_path / "texts"


def test_descriptions_are_of_spans_in_seconds(texts):
    (texts / "texts" / "000000.txt").write_text("whole#x#0.0#0.0\npart#x#0.5#9.0\n")
    with (texts / "index.csv").open("a") as file:
        file.write("./pose_data/MPI_HDM05/bk/a_poses.npy,10,40,000001.npy\n")
    found = humanml3d(texts)
    spans = [(one.start, one.end, one.sentences) for one in found["KIT/3/walk02"]]
    assert spans == [(0.0, 2.0, ("whole",)), (0.5, 2.0, ("part",)), (2.0, 4.0, ("a man stops",))]
    # Three seconds of this set are dropped before frames are counted.
    assert [(one.start, one.end) for one in found["MPI_HDM05/bk/a"]] == [(3.5, 5.0)]
    assert motion_name("KIT/3/walk02_stageii.npz") == "KIT/3/walk02"


def test_what_is_wrong_with_descriptions_is_named(texts):
    path = texts / "texts" / "000001.txt"
    path.write_text("no fields\n")
    with pytest.raises(DataError, match="000001.txt: line 1: expected sentence#tokens#from#to"):
        humanml3d(texts)
    path.unlink()
    with pytest.raises(DataError, match="000001.txt: there is no such file: index.csv lists it"):
        humanml3d(texts)
    (texts / "index.csv").write_text("a,b\n")
    with pytest.raises(DataError, match="expected columns"):
        humanml3d(texts)


def test_an_import_goes_on_after_the_sets_that_are_done(tmp_path):
    base_sources.amass(tmp_path / "amass", tmp_path / "texts")
    base_sources.librispeech(tmp_path / "libri")
    plan = {"least_seconds": 2.5, "amass": {"root": "amass"}, "librispeech": {"root": "missing"}}
    folder = tmp_path / "corpus"
    with pytest.raises(DataError, match="missing"):
        import_clips(plan, tmp_path, folder, 100)
    first = corpus.paths(folder, "motion")[0]
    written = first.stat().st_mtime_ns
    import_clips(plan | {"librispeech": {"root": "libri"}}, tmp_path, folder, 100)
    assert first.stat().st_mtime_ns == written
    # One of two utterances is long enough.
    found = [(entry.name, entry.spoken, entry.text) for entry in corpus.entries(folder)]
    assert found == [("00000", False, ""), ("00001", False, ""), ("00002", True, "my old friend walks and stops")]


def test_prompts_of_clips_come_from_a_table(tmp_path):
    base_sources.beat2(tmp_path / "beat")
    (tmp_path / "prompts.csv").write_text("id,text\n2_scott_0_1_1,calm\n2_scott_0_1_1,quiet\n")
    plan = {"least_seconds": 1, "beat2": {"root": "beat", "prompts": "prompts.csv", "splits": {"train": ["train"]}}}
    import_clips(plan, tmp_path, tmp_path / "corpus", 100)
    assert [entry.prompt for entry in corpus.entries(tmp_path / "corpus", "train")] == ["calm\nquiet"]


def test_weights_of_a_face_follow_its_width():
    arkit, expressions = weights("face", 58), weights("face", 106)
    assert len(arkit) == 58 and len(expressions) == 106
    assert len(set(expressions.tolist())) == 1 and len(set(arkit.tolist())) > 3


CONFIG = {
    "vocab": {"eos": 1, "audio": {"first": 500, "start": 600, "end": 601, "mask": 602, "codes": 90}}
    | {part: {"first": 100 * i + 100, "codes": 30, "start": 100 * i + 190, "end": 100 * i + 191, "mask": 100 * i + 192}
       for i, part in enumerate(("face", "hands", "upper", "lower"))},
    "rest": dict.fromkeys(("face", "hands", "upper", "lower"), 3),
    "keyframe_stride": 6, "prefix": 2, "frame_rate": 30, "audio": {"token_rate": 50},
    "templates": {"text_to_motion": ["text", "face", "hands", "upper", "lower", 1]},
}  # fmt: skip
NOTHING = np.zeros(0, int)


def streams():
    codes = np.arange(60)[None].repeat(4, 0) % 30
    silent = codes.copy()
    silent[0] = -1
    units = np.arange(100)[None] % 90
    spoken = np.array([[10, 20], [20, 30], [70, 80]])
    return {
        "both": Stream(codes, units, np.array([11, 12, 13]), NOTHING, spoken=spoken),
        "motion": Stream(silent, None, NOTHING, np.array([21]), (np.array([22]),)),
        "speech": Stream(None, units[:, :50], np.array([14, 15]), NOTHING),
    }


def test_tasks_draw_from_the_items_that_have_what_they_need():
    examples = Examples(CONFIG, list(streams().values()), 0)
    seconds = {task: examples.seconds(task) for task in ("motion", "a2t", "a2m", "t2m_dense", "a2m_prompted")}
    assert seconds == {"motion": 4.0, "a2t": 3.0, "a2m": 2.0, "t2m_dense": 2.0, "a2m_prompted": 0}
    with pytest.raises(ValueError, match="no item has codes and units and prompt"):
        examples.chunk(1, 1, np.random.default_rng(0), text=True)


def test_faces_that_are_not_known_are_neither_shown_nor_asked():
    examples = Examples(CONFIG, [streams()["motion"]], 0)
    batch = examples.dense(8, 12, np.random.default_rng(0), source="text")
    assert (batch.labels[:, 1:13] == -100).all() and (batch.labels[:, 15:27] >= 200).all()
    # A prompt, then the face's start, its history (masked, or rest before the beginning) and its end.
    assert set(batch.ids[:, 0]) == {21, 22}
    assert set(batch.ids[:, 2:4].flatten()) <= {192, 103} and (batch.ids[:, 4] == 191).all()


def test_what_is_said_in_a_window_is_asked_where_times_are_known():
    examples = Examples(CONFIG, [streams()["both"]], 0, templates={"audio_to_text": [7, "audio", 1]})
    batch = examples.speech(200, 1.0, np.random.default_rng(0), to="text")
    found = set()
    for ids, labels in zip(batch.ids, batch.labels, strict=True):
        assert ids[0] == 7 and ids[1] == 600 and len(ids) == 54
        at = int(ids[2] - 500)
        inside = [text for text, (a, b) in zip((11, 12, 13), ((10, 20), (20, 30), (70, 80)), strict=True)
                  if a >= at and b <= at + 50]  # fmt: skip
        assert [x for x in labels if x != -100] == [*inside, 1]
        found.add(tuple(inside))
    assert {(11, 12), (12,), (13,)} <= found


def test_short_speech_is_taken_as_long_as_it_is():
    batch = Examples(CONFIG, [streams()["speech"]], 0).speech(2, 16.0, np.random.default_rng(0), to="audio")
    assert batch.ids.tolist() == [[14, 15, 1]] * 2 and batch.labels.shape == (2, 52)
